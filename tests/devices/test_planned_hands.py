"""Hands that are led by waypoints, and hands that grasp: where they are at each time, and what they cannot do."""

import pytest

from cogrip.devices.device import DeviceError

from tests.devices.held_device import opened

GRASP = "grasp&gap_m=0.04&press_n=6&line_npm=600&lift_m=0.05&carry_m=0.1,0.02,-0.03&start_s=1&stroke_s=0.5&hold_s=2"


def hand_of(keys: str, axes: int = 3, machine: str = "ideal"):
    return opened(f"sim:{machine}?hand={keys}", axes, 1000).hand


def is_at_rest(hand, time_s: float, place: tuple[float, ...]) -> None:
    there, speed = hand.intended(round(1000 * time_s))
    assert there == pytest.approx(place, abs=1e-12), time_s
    assert speed == pytest.approx((0, 0, 0), abs=1e-9), time_s


def test_waypoints_are_reached_in_time_and_rested_at() -> None:
    hand = hand_of("waypoints&times_s=1,2,4&x_m=0,0.1,-0.1&z_m=0,0,0.2")
    for time_s, x, z in ((0, 0, 0), (1, 0, 0), (2, 0.1, 0), (4, -0.1, 0.2), (9, -0.1, 0.2)):
        is_at_rest(hand, time_s, (x, 0, z))
    assert hand.intended(3000)[0] == pytest.approx((0, 0, 0.1), abs=1e-12)


def test_velocity_between_waypoints_is_that_of_the_place() -> None:
    hand = hand_of("waypoints&times_s=0,0.5&y_m=0,0.1&hand_stiffness_npm=200&hand_damping_nspm=3")
    for tick in range(1, 499):
        (_, early, _), (_, late, _) = hand.intended(tick - 1)[0], hand.intended(tick + 1)[0]
        place, speed = hand.intended(tick)
        assert speed[1] == pytest.approx((late - early) * 500.0, abs=2e-5)
        assert hand.drive(tick) == pytest.approx([200.0 * x + 3.0 * v for x, v in zip(place, speed, strict=True)])


def test_a_grasp_is_where_each_stage_ends() -> None:
    """6 N through 300 and 600 N/m in series are 30 mm beyond the face."""
    hand = hand_of(f"{GRASP}&direction=-1&first_m=0,0,0.01")
    is_at_rest(hand, 1.0, (0, 0, 0))
    is_at_rest(hand, 1.5, (0, 0, 0.01))
    is_at_rest(hand, 2.0, (-0.04, 0, 0.01))
    is_at_rest(hand, 2.5, (-0.07, 0, 0.01))
    is_at_rest(hand, 3.0, (-0.07, 0, 0.06))
    for time_s in (3.5, 5.5):
        is_at_rest(hand, time_s, (0.03, 0.02, 0.06))
    is_at_rest(hand, 6.0, (0.03, 0.02, -0.02))
    for time_s in (6.5, 9.0):
        is_at_rest(hand, time_s, (0.1, 0.02, -0.02))


def test_stages_of_a_grasp_that_do_not_move_take_no_time() -> None:
    hand = hand_of("grasp&gap_m=0.04&press_n=3&start_s=1&stroke_s=0.5")
    for tick, x_m in ((1500, 0.04), (2000, 0.05), (2500, 0.0)):
        assert hand.intended(tick)[0] == pytest.approx((x_m, 0, 0), abs=1e-12)


def test_a_grasp_on_a_machine_that_turns_keeps_its_orientation() -> None:
    hand = hand_of(GRASP, 6, "freeflyer")
    assert hand.intended(3000)[0][3:] == (0.0, 0.0, 0.0)
    assert hand.intended(1500)[0][:3] == pytest.approx((0.04, 0, 0))


@pytest.mark.parametrize(
    ("keys", "axes", "words"),
    [
        (GRASP, 1, r"hand=grasp: the device has 1 axes, and grasping takes places; set object\.axes = 3 or 6"),
        (
            "grasp&hand_stiffness_npm=0",
            3,
            "hand=grasp: hand_stiffness_npm=0 presses with nothing; raise it, or set press_n=0",
        ),
        ("grasp&carry_m=1,2,3,4", 3, r"carry_m=1\.0,2\.0,3\.0,4\.0 has 4 numbers"),
        ("grasp&lift=1", 3, "lift_m"),
        ("waypoints&times_s=1,1&x_m=0,1", 3, r"times_s=1\.0,1\.0 do not rise; give each later than the last"),
        ("waypoints&times_s=1,2&x_m=0", 3, r"x_m has 1 places for 2 times; give 2"),
        ("waypoints&times_s=1,2&z_m=0,1", 1, r"z_m is given, but the device has 1 axes; leave it out"),
        ("waypoints&x_m=0,1", 3, "times_s"),
    ],
)
def test_what_they_cannot_do(keys: str, axes: int, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        hand_of(keys, axes)
