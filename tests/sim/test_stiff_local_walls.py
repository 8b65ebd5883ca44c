"""Local walls that are met hard: what the linear model calls stable rings down in a session, and holds the hand."""

from typing import Any

import pytest

from cogrip.analysis.advice.advice import AMPLE, advise
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.verdict.verdict import passive, stable
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory


def wall(stiffness_npm: float, damping_nspm: float, push_n: float, device: str = "sim:ideal") -> Settings:
    """Return a hand that begins to push at once, on the surface of a wall: its force rings at sqrt(K / m)."""
    return resolve(
        {
            "seconds": 3.0,
            "coupling": {"kind": "local", "stiffness_npm": stiffness_npm, "damping_nspm": damping_nspm},
            "object": {"kind": "wall", "axes": 1},
            "link": {"delay_ms": 20.0},
            "users": [{"name": "a", "device": device, "hand": f"push&force_n={push_n}&start_s=0.6", "side": "left"}],
        }
    )


def run(settings: Settings) -> tuple[Laboratory, Any]:
    laboratory = Laboratory(settings)
    laboratory.run()
    return laboratory, of_laboratory(laboratory)


def test_a_ring_that_decays_is_not_let_go_and_the_wall_stays_a_wall() -> None:
    """29 Hz, damped by 0.2: three fast turns took the damper from the wall and left it its spring, so that it rang the more."""
    settings = wall(3316.0, 7.2, 2.96)
    laboratory, summary = run(settings)
    assert advise(settings).limit.stiffness_npm > 4.0 * 3316.0
    assert passive(summary).tone == stable(summary).tone == "good"
    [person] = summary["users"]
    assert person["let_go"] == 0
    assert person["controlled"] == 0.0
    assert person["felt_stiffness_npm"] == pytest.approx(3316.0, rel=0.01)
    assert laboratory.people[0].device.position_m[0] == pytest.approx(2.96 / 3316.0, rel=0.01)


@pytest.mark.sample(6)
@pytest.mark.parametrize("device", ["sim:ideal", "sim:phantom"])
@pytest.mark.parametrize("damping_nspm", [2.0, 7.2])
@pytest.mark.parametrize("share", [0.2, 1.0 / AMPLE])
@pytest.mark.parametrize("push_n", [1.0, 3.0])
def test_what_the_model_calls_ample_holds_the_hand(
    device: str, damping_nspm: float, share: float, push_n: float
) -> None:
    limit = advise(wall(1000.0, damping_nspm, push_n, device)).limit.stiffness_npm
    assert limit is not None
    stiffness = share * limit
    laboratory, summary = run(wall(stiffness, damping_nspm, push_n, device))
    assert passive(summary).tone == stable(summary).tone == "good"
    assert summary["users"][0]["let_go"] == 0
    [rendered] = {
        person.core.seated.coupling.contact.spring.stiffness for person in laboratory.people
    }  # the port may take from it
    assert laboratory.people[0].device.position_m[0] == pytest.approx(push_n / rendered, rel=0.05, abs=1e-4)


@pytest.mark.parametrize(("stiffness_npm", "damping_nspm"), [(8847.0, 7.2), (8192.0, 20.0), (24576.0, 20.0)])
def test_a_wall_that_the_motors_cannot_follow_throws_no_hand(stiffness_npm: float, damping_nspm: float) -> None:
    """6 N at once ask for more than the slope limit of 1000 N/s: the surface yields, and is where it is afterwards."""
    laboratory, summary = run(wall(stiffness_npm, damping_nspm, 6.0))
    assert not summary["unstable"]
    assert summary["users"][0]["let_go"] == 0
    assert summary["users"][0]["travel_m"] < 0.1
    assert 0.0 < laboratory.people[0].device.position_m[0] < 0.005
