"""Hand that grasps: where it is after each stage, what it presses with, and what it cannot do."""

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.registry import make

KEYS = "gap_m=0.04&press_n=6&line_npm=600&lift_m=0.05&carry_m=0.1,0.02,-0.03&start_s=1&stroke_s=0.5&hold_s=2"


def hand_of(keys: str, axes: int = 3, machine: str = "ideal"):
    device = make(f"sim:{machine}?hand=grasp&{keys}", axes=axes)
    device.hand.open(1000, None)
    return device.hand


def test_it_is_where_each_stage_ends() -> None:
    """6 N through 300 and 600 N/m in series are 30 mm beyond the face."""
    hand = hand_of(f"direction=-1&first_m=0,0,0.01&{KEYS}")
    ends = {
        1.0: (0, 0, 0),
        1.5: (0, 0, 0.01),
        2.0: (-0.04, 0, 0.01),
        2.5: (-0.07, 0, 0.01),
        3.0: (-0.07, 0, 0.06),
        3.5: (0.03, 0.02, 0.06),
        5.5: (0.03, 0.02, 0.06),
        6.0: (0.03, 0.02, -0.02),
        6.5: (0.1, 0.02, -0.02),
        9.0: (0.1, 0.02, -0.02),
    }
    for time_s, place in ends.items():
        there, speed = hand.intended(round(1000 * time_s))
        assert there == pytest.approx(place, abs=1e-12), time_s
        assert speed == pytest.approx((0, 0, 0), abs=1e-9)


def test_stages_that_do_not_move_take_no_time() -> None:
    hand = hand_of("gap_m=0.04&press_n=3&start_s=1&stroke_s=0.5")
    assert hand.intended(1500)[0] == pytest.approx((0.04, 0, 0))
    assert hand.intended(2000)[0] == pytest.approx((0.05, 0, 0))
    assert hand.intended(2500)[0] == pytest.approx((0, 0, 0), abs=1e-12)


def test_on_a_machine_that_turns_it_keeps_its_orientation() -> None:
    hand = hand_of(KEYS, 6, "freeflyer")
    assert hand.intended(3000)[0][3:] == (0.0, 0.0, 0.0)
    assert hand.intended(1500)[0][:3] == pytest.approx((0.04, 0, 0))


@pytest.mark.parametrize(
    ("keys", "axes", "words"),
    [
        (KEYS, 1, r"hand=grasp: the device has 1 axes, and grasping takes places; set object\.axes = 3 or 6"),
        (
            "hand_stiffness_npm=0",
            3,
            r"hand=grasp: hand_stiffness_npm=0 presses with nothing; raise it, or set press_n=0",
        ),
        ("carry_m=1,2,3,4", 3, r"carry_m=1\.0,2\.0,3\.0,4\.0 has 4 numbers"),
        ("lift=1", 3, "lift_m"),
    ],
)
def test_what_it_cannot_do(keys: str, axes: int, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        hand_of(keys, axes)
