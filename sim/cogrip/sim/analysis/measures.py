"""What the lifted model says of a session, by name: for sweeps and for whoever wants one number."""

from __future__ import annotations

from collections.abc import Callable

from cogrip.protocol.settings import Settings
from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.linear_session import linear_session
from cogrip.sim.analysis.stability import largest_stable, verdict

Value = float | bool | None


def _model(settings: Settings) -> LiftedModel:
    return LiftedModel(linear_session(settings))


LIFTED: dict[str, Callable[[Settings], Value]] = {
    "lifted.spectral_radius": lambda settings: verdict(_model(settings)).spectral_radius,
    "lifted.decaying_radius": lambda settings: verdict(_model(settings)).decaying,
    "lifted.stable": lambda settings: verdict(_model(settings)).stable,
    "lifted.largest_stable_stiffness_npm": lambda settings: largest_stable(_model(settings)).stiffness_npm,
}
