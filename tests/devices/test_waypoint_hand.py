"""Hand that is led by waypoints: there at each time, at rest, and smooth between."""

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.registry import make


def hand_of(keys: str, axes: int = 3):
    device = make(f"sim:ideal?hand=waypoints&{keys}", axes=axes)
    device.hand.open(1000, None)
    return device.hand


def test_it_is_at_each_place_in_time_and_rests_before_and_after() -> None:
    hand = hand_of("times_s=1,2,4&x_m=0,0.1,-0.1&z_m=0,0,0.2")
    places = {
        0: (0, 0, 0),
        1000: (0, 0, 0),
        2000: (0.1, 0, 0),
        3000: (0, 0, 0.1),
        4000: (-0.1, 0, 0.2),
        9000: (-0.1, 0, 0.2),
    }
    for tick, place in places.items():
        there, speed = hand.intended(tick)
        assert there == pytest.approx(place, abs=1e-12)
        if tick != 3000:
            assert speed == pytest.approx((0, 0, 0), abs=1e-12)


def test_its_velocity_is_that_of_its_place() -> None:
    hand = hand_of("times_s=0,0.5&y_m=0,0.1&hand_stiffness_npm=200&hand_damping_nspm=3")
    for tick in range(1, 499):
        (_, early, _), (_, late, _) = hand.intended(tick - 1)[0], hand.intended(tick + 1)[0]
        place, speed = hand.intended(tick)
        assert speed[1] == pytest.approx((late - early) * 500.0, abs=2e-5)
        assert hand.drive(tick) == pytest.approx([200.0 * x + 3.0 * v for x, v in zip(place, speed, strict=True)])


@pytest.mark.parametrize(
    ("keys", "axes", "words"),
    [
        ("times_s=1,1&x_m=0,1", 3, r"times_s=1\.0,1\.0 do not rise; give each later than the last"),
        ("times_s=1,2&x_m=0", 3, r"x_m has 1 places for 2 times; give 2"),
        ("times_s=1,2&z_m=0,1", 1, r"z_m is given, but the device has 1 axes; leave it out"),
    ],
)
def test_waypoints_that_do_not_fit(keys: str, axes: int, words: str) -> None:
    with pytest.raises(DeviceError, match=words):
        hand_of(keys, axes)
    with pytest.raises(DeviceError, match="times_s"):
        hand_of("x_m=0,1")
