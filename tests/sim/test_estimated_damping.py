"""The damper at the device works on an estimated velocity: what its lag costs (theory section 3.6)."""

import pytest

from cogrip.client import core
from cogrip.client.velocity import AlphaBeta
from cogrip.protocol.settings import resolve
from cogrip.sim.laboratory import Laboratory
from cogrip.sim.summary import of_laboratory


def session(mass_kg):
    users = [
        {"name": "anna", "hand": "reach", "device_mass_kg": mass_kg},
        {"name": "ben", "hand": "reach&delay_s=0.15", "device_mass_kg": mass_kg},
    ]
    laboratory = Laboratory(
        resolve({"seconds": 4.0, "link": {"delay_ms": 20.0}, "playout": {"frames": 1}, "users": users})
    )
    laboratory.run()
    return of_laboratory(laboratory)["users"]


@pytest.mark.parametrize("mass_kg", [0.045, 0.075, 0.1])
def test_a_light_arm_stays_quiet(mass_kg):
    for user in session(mass_kg):
        assert user["peak_force_n"] < 2.0
        assert user["energy"]["device_leak_j"] > -0.05


def test_a_slower_estimate_would_not_do(monkeypatch):
    monkeypatch.setattr(core, "AlphaBeta", lambda axes, tick_s: AlphaBeta(axes, tick_s, memory=0.8))
    assert min(user["energy"]["device_leak_j"] for user in session(0.045)) < -1.0
