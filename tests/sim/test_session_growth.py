"""Tests that sessions in virtual time grow where the lifted model says so, decay where not, and as fast as it says.

Theory section 6's two users. The devices get one small kick; the signal is the force that client 0 writes, which rigid motion
does not have. Ramps (0.3 s) are over before anything is measured.
"""

from itertools import product
from typing import Any

import numpy as np
import pytest

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import form_overrides, linear_session
from cogrip.analysis.linear.stability import largest_stable, verdict
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.sim.session_measures import FRAME_MS

SKIPPED = 128  # frames
WINDOW = 128  # frames: longer than a beat of what is watched, near a quarter of the frames' rate too, with the frames
KICKS_MPS = (1e-8, -4e-9)


def settings_at(scheme: Any, frames: int, stiffness: float) -> Settings:
    people = [{"name": name, "device": "sim:ideal", "hand": "push&force_n=0"} for name in ("a", "b")]
    table = {"seconds": 100.0, "link": {"delay_ms": frames * FRAME_MS}, "users": people}
    return resolve(table, {**form_overrides(scheme), "coupling.stiffness_npm": stiffness})


def model(settings: Settings) -> LiftedModel:
    return LiftedModel(linear_session(settings, estimated=False))


def growth(settings: Settings, frames: int) -> float:
    """Return the logarithm of the growth per frame of the force, from the slope of its envelope over `frames` frames."""
    laboratory = Laboratory(settings)
    for person, kick in zip(laboratory.people, KICKS_MPS, strict=True):
        person.device.plant.velocity_mps = [kick]
    forces = []
    for _ in range(SKIPPED + frames):
        laboratory.frame()
        forces.append(abs(laboratory.people[0].core.force_n[0]))
    assert not laboratory.incident
    windows = np.array(forces[SKIPPED:])[: frames // WINDOW * WINDOW].reshape(-1, WINDOW)
    late = windows[len(windows) // 3 :]  # the slowest mode alone
    assert late.min() > 0.0
    assert late.max() < 0.1  # no clamp was ever near
    slope, _ = np.polyfit(np.arange(len(late)) * WINDOW, np.log(late.max(axis=1)), 1)
    return float(slope)


def long_enough(rate: float) -> int:
    """Return the frames in which a growth of `rate` a frame makes e^2, between 6 and 12 s."""
    return int(min(12 * 128, max(6 * 128, 2.0 / abs(rate))))


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("scheme", "frames"), every(4, (*product(("paper",), (0, 1, 2, 4)), *product(("coupling",), (1, 2, 4))))
)
def test_a_session_grows_beyond_its_limit_and_decays_before(scheme: str, frames: int) -> None:
    limit = largest_stable(model(settings_at(scheme, frames, 1.0))).stiffness_npm
    for share, sign in ((0.98, -1.0), (1.02, 1.0)):
        settings = settings_at(scheme, frames, share * limit)
        rate = float(np.log(verdict(model(settings)).decaying))
        assert np.sign(rate) == sign
        measured = growth(settings, long_enough(rate))
        assert np.sign(measured) == sign
        assert measured == pytest.approx(rate, rel=0.05)


@pytest.mark.long
def test_virtual_coupling_without_delay_grows_as_predicted() -> None:
    """Theory section 5: its answers are ahead of the hands, at any stiffness; here so little that no clamp is near."""
    settings = settings_at("coupling", 0, 5.0)
    assert largest_stable(model(settings)).stiffness_npm == 0.0
    rate = float(np.log(verdict(model(settings)).decaying))
    assert rate > 0.0
    assert growth(settings, long_enough(rate)) == pytest.approx(rate, rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("stiffness", every(3, [1e2, 1e4, 1e6]))
def test_the_passive_scheme_decays_as_predicted(stiffness: float) -> None:
    settings = settings_at("passive", 4, stiffness)
    rate = float(np.log(verdict(model(settings)).decaying))
    assert rate < 0.0
    frames = min(12 * 128, max(4 * 128, int(6.0 / -rate)))
    assert growth(settings, frames) == pytest.approx(rate, rel=0.05)
