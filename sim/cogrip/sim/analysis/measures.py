"""Numbers of the lifted model by name, for sweeps."""

from __future__ import annotations

from collections.abc import Callable

from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.feel import Slow, on_wall, slow_feel
from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.linear_session import linear_session
from cogrip.sim.analysis.stability import largest_stable, verdict

Value = float | bool | None


def _model(settings: Settings) -> LiftedModel:
    return LiftedModel(linear_session(settings))


def _slow(settings: Settings) -> Slow:
    session = linear_session(settings)
    return slow_feel(on_wall(session, 0), 0)


LIFTED: dict[str, Callable[[Settings], Value]] = {
    "lifted.spectral_radius": lambda settings: verdict(_model(settings)).spectral_radius,
    "lifted.radius_without_structural": lambda settings: verdict(_model(settings)).decaying,
    "lifted.decaying_radius": lambda settings: verdict(_model(settings)).decaying,  # its former name
    "lifted.stable": lambda settings: verdict(_model(settings)).stable,
    "lifted.largest_stable_stiffness_npm": lambda settings: largest_stable(_model(settings)).stiffness_npm,
    "lifted.felt_stiffness_npm": lambda settings: _slow(settings).stiffness_npm,
    "lifted.felt_damping_nspm": lambda settings: _slow(settings).damping_nspm,
    "lifted.felt_inertia_kg": lambda settings: _slow(settings).inertia_kg,
}
"""Numbers of the whole session; felt values are those of user 0 of an object that cannot move."""
