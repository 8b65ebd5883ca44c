"""The wizard's trials: signs of axes and a weak spring, by their laws put back, on devices in virtual time."""

from functools import partial
from math import hypot

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices import Capability, DeviceError, Sample, make, trial
from cogrip.devices.registry import record_of
from cogrip.devices.trial import (
    LEAST_MOVED_M,
    MOST_N,
    MOVED_M,
    RATE_HZ,
    STIFFEST_NPM,
    Moved,
    Spring,
    feel,
    moved,
    watch,
)

from tests.devices import held_device
from tests.extent import long
from tests.interpreted import needs_interpreted

RISEN = round(trial.RISE_S * RATE_HZ)
STILL = Sample((0.0, 0.0, 0.0), None)
AT_ONCE = (lambda tick: tick, lambda sample: None)  # every tick is now, and nothing is shown
opened = partial(held_device.opened, axes=3, rate_hz=RATE_HZ)


@pytest.mark.parametrize(
    ("now_m", "found"),
    [
        ((MOVED_M, 0.0, 0.0), Moved(0, 1)),
        ((0.999 * MOVED_M, 0.0, 0.0), None),
        ((0.0, -MOVED_M, 0.01), Moved(1, -1)),
        ((0.021, 0.02, -0.03), Moved(2, -1)),
        ((0.0,), None),
    ],
)
def test_the_axis_that_moved_most_is_found(now_m: tuple[float, ...], found: Moved | None) -> None:
    assert moved((0.0,) * len(now_m), now_m) == found
    if found is not None:  # only the axis itself and its growth are right
        assert [found.is_right(axis) for axis in range(3)] == [
            found.sense > 0 and axis == found.axis for axis in range(3)
        ]


@pytest.mark.parametrize(
    ("direction", "found"), [("1,0,0", Moved(0, 1)), ("0,-1,0", Moved(1, -1)), ("0,0,1", Moved(2, 1))]
)
@pytest.mark.parametrize("device", ["emulated:vintage", "emulated:inverse3", "sim:phantom"])
def test_a_hand_s_motion_is_seen_on_a_device(device: str, direction: str, found: Moved) -> None:
    assert watch(opened(f"{device}?hand=reach&amplitude_m=0.04&direction={direction}"), *AT_ONCE) == found


def test_a_device_that_nobody_moves_is_watched_for_no_longer_than_said() -> None:
    ticks: list[int] = []
    assert watch(opened("sim:ideal?hand=hold"), lambda tick: ticks.append(tick) or tick, AT_ONCE[1]) is None
    assert ticks[-1] == round(trial.SIGN_S * RATE_HZ)


def test_an_axis_wired_the_other_way_round_is_found() -> None:
    """The vintage arm's turret is its y."""
    address = "emulated:vintage?hand=reach&amplitude_m=0.04&direction=0,1,0"
    assert watch(opened(address), *AT_ONCE) == Moved(1, 1)
    assert watch(opened(f"{address}&dir=1,1,1"), *AT_ONCE) == Moved(1, -1)


RECORD = record_of(make("sim:phantom", axes=3), "sim:phantom")


def risen(record: Capability = RECORD) -> Spring:
    spring = Spring(record)
    for tick in range(RISEN + 1):
        spring.force_n(tick, STILL)
    return spring


@given(st.tuples(*[st.floats(-0.002, 0.002)] * 3))
def test_the_spring_is_its_law_and_loads_the_hand(away_m: tuple[float, ...]) -> None:
    """F = K d once it has risen: positive F resists motion in +x."""
    spring = risen()
    force = spring.force_n(RISEN + 1, Sample(away_m, None))
    assert force == pytest.approx([STIFFEST_NPM * d for d in away_m])


@pytest.mark.parametrize(("size_m", "size_n"), [(0.0049, 0.98), (0.0051, MOST_N), (0.05, MOST_N)])
def test_its_force_keeps_its_direction_at_its_limit(size_m: float, size_n: float) -> None:
    spring = risen()
    force: tuple[float, ...] = ()
    for part in range(1, 401):  # slowly, as a hand
        force = spring.force_n(RISEN + part, Sample((0.6 * size_m * part / 400, 0.8 * size_m * part / 400, 0.0), None))
    assert hypot(*force) == pytest.approx(size_n, rel=1e-6)
    assert force[1] / force[0] == pytest.approx(4.0 / 3.0)


def test_it_rises_and_is_never_more_than_half_of_what_the_device_has() -> None:
    spring = Spring(RECORD)
    assert not any(spring.force_n(0, STILL))
    half = spring.force_n(RISEN // 2, Sample((0.001, 0.0, 0.0), None))
    assert half[0] == pytest.approx(0.5 * STIFFEST_NPM * 0.001, rel=0.01)
    weak = make("haply:/dev/x?model=2diy", axes=2).capability
    assert Spring(weak).most_n <= 0.5 * weak.peak_force_n
    assert Spring(weak).stiffness_npm <= 0.25 * weak.stiffness_npm


def test_it_lets_go_of_a_tip_that_leaves_or_runs_or_is_not_heard_of() -> None:
    spring = risen()
    assert not any(spring.force_n(RISEN + 1, Sample((0.2, 0.0, 0.0), None)))
    assert spring.ended == "the tip left the workspace"
    spring = risen()
    for tick in range(1, 40):  # 3 m/s
        force = spring.force_n(RISEN + tick, Sample((0.003 * tick, 0.0, 0.0), None))
    assert spring.ended == "the tip moved too fast"
    assert not any(force)
    spring = risen()
    spring.force_n(RISEN + 1, Sample((0.001, 0.0, 0.0), None))
    silent = int(trial.SILENT_S * RATE_HZ)
    assert any(spring.force_n(RISEN + 1 + silent, None))
    assert not any(spring.force_n(RISEN + 2 + silent, None))
    assert spring.ended == "no samples"
    assert not any(spring.force_n(RISEN + 3 + silent, Sample((0.001, 0.0, 0.0), None)))


@pytest.mark.parametrize(
    "device", ["emulated:vintage", *map(long, ("emulated:inverse3", "emulated:woodenhaptics")), "sim:phantom"]
)
def test_a_spring_is_felt_as_stiff_as_it_was_asked_for(device: str) -> None:
    felt = feel(opened(f"{device}?hand=reach&amplitude_m=0.01"), *AT_ONCE)
    assert felt.ended == ""
    assert felt.felt_npm == pytest.approx(felt.asked_npm, rel=0.03)
    assert LEAST_MOVED_M < felt.most_m < 0.01
    assert 0.0 < felt.most_n <= MOST_N * (1.0 + 1e-9)


@needs_interpreted
def test_motors_that_give_half_are_felt_as_half() -> None:
    """The force that acts counts, not the one that was asked for."""
    device = opened("sim:phantom?hand=reach&amplitude_m=0.01")
    write = device.write
    device.write = lambda force: write(half := [0.5 * part for part in force]) or half  # type: ignore[method-assign]
    felt = feel(device, *AT_ONCE)
    assert felt.felt_npm == pytest.approx(0.5 * felt.asked_npm)


def test_a_device_that_is_held_still_tells_nothing() -> None:
    felt = feel(opened("emulated:vintage?hand=hold"), *AT_ONCE)
    assert felt.felt_npm == 0.0
    assert felt.most_m < LEAST_MOVED_M


def test_a_device_that_is_lost_meanwhile_is_an_error_with_no_force_left() -> None:
    device = opened("emulated:inverse3?hand=reach&amplitude_m=0.02&faults=unplug@1")
    with pytest.raises(DeviceError, match="lost: it was unplugged"):
        feel(device, *AT_ONCE)
    assert device.firmware.mechanics.force_n == (0.0, 0.0, 0.0)  # type: ignore[attr-defined]
    assert trial.SPRING_S > 1.0
