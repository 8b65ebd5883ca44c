"""The driver of an arm on a serial line, over the emulated firmware, in virtual time. Its pose: test_arm_pose."""

from itertools import product
from math import dist, hypot, inf, nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cogrip.devices.arm.driver import GOODBYES, HEADROOM, SILENT_S
from cogrip.devices.arm.models import MODELS
from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.faults import VERBS
from cogrip.devices.serial.frames import MODELS as NUMBERS

from tests.devices.arm_bench import NO_FORCE, RATE_HZ, Bench, least_force_n, opened
from tests.devices.held_device import refused
from tests.extent import every

NAMES = tuple(NUMBERS.values())
every_model = pytest.mark.parametrize("name", NAMES)


@pytest.mark.parametrize(("axes", "name"), every(2, product((1, 2, 3), NAMES)))
def test_the_position_is_the_true_one_within_a_count(name: str, axes: int) -> None:
    bench = opened(name, hand="tremor&tremor_m=0.002&direction=1,-0.7,0.5", axes=axes)
    assert bench.hold((0.0,) * axes, 1) == [None]  # nothing was asked for yet
    seen = set()
    for _ in range(299):
        true_m = bench.position_m
        [sample] = bench.hold((0.0,) * axes, 1)
        assert (sample.age_ticks, sample.velocity_mps) == (1, None)
        assert dist(sample.position_m, true_m) <= 3**0.5 * 0.5 * bench.capability.resolution_m * 1.1
        seen.add(sample.position_m)
    assert len(seen) > 20
    assert bench.counts == {}


FORCES = ((0.6, 0.0, 0.0), (0.0, -0.6, 0.0), (0.0, 0.0, 0.5), (-0.3, 0.4, 0.3), (0.5,), (0.5, -0.4))
PLACES = ((0.0, 0.0, 0.0), (0.02, -0.03, 0.01), (-0.03, 0.02, -0.02))


@pytest.mark.parametrize(("force", "at_m", "name"), every(5, product(FORCES, PLACES, NAMES)))
def test_the_hand_is_loaded_with_what_was_asked_for_within_a_milliampere(name: str, at_m, force) -> None:
    """And axes that nobody uses get no force."""
    bench = Bench(name, hand=f"hold&x0_m={at_m[0]},{at_m[1]},{at_m[2]}", axes=len(force))
    least = least_force_n(bench.arm)
    bench.open(RATE_HZ)
    bench.hold(force, 400)  # until the weight of a Polhem is held too
    assert bench.force_n == pytest.approx(force, abs=least + 2e-3)  # 2 mN: the sample is a tick old
    mechanics, whole_n = bench.arm.mechanics, (*force, 0.0, 0.0)[:3]
    if name != "polhem":  # whose weight is held on every axis
        assert np.negative(mechanics.force_n) == pytest.approx(whole_n, abs=least + 2e-3)
    assert np.dot(np.subtract(mechanics.body.position_m, at_m), whole_n) < 0.0  # the arm pushes the hand with -F
    assert "force limited to the motors" not in bench.counts


def test_the_numbers_on_the_wire_are_the_printed_ones() -> None:
    """Hand-worked case: at raw counts 400, -300, 200 the arm must push with (1, -2, 0.5) N, so F is the opposite."""
    bench = opened(keys="pose=home&limit_ma=2000,2000,2000")
    model = bench.driver.model
    tip = model.kinematics.forward(model.drive.angles((400, 7400, 200)))
    bench.arm.mechanics.carry(tip)
    bench.read(0)
    bench.write(NO_FORCE)
    bench.driver.read(1)  # the arm stands still meanwhile
    assert bench.driver.reading.raw == (400, -300, 200)
    bench.driver.write((-1.0, 2.0, -0.5))
    assert bench.sent[-1] == b"[1217,-328,-693]\n"


@given(force=st.tuples(*[st.floats(-60.0, 60.0)] * 3))
@hypothesis_settings(max_examples=60)
def test_limits_hold_and_keep_the_direction(force) -> None:
    bench = opened()
    bench.hold(force, 3)
    acting = bench.write(force)
    currents = bench.arm.mechanics.currents_ma
    assert max(map(abs, currents)) <= 999
    given_n = bench.force_n
    size = hypot(*given_n)
    assert size <= 5.0 * 1.01
    if hypot(*force) > 0.5:
        cosine = sum(a * b for a, b in zip(force, given_n, strict=True)) / hypot(*force) / size
        assert cosine > 0.999
    limited = hypot(*force) > 5.0
    if limited:
        assert bench.counts["force limited to the motors"] >= 1
        assert acting is not None
    if acting is not None:
        assert acting == pytest.approx(given_n, abs=0.02)


def test_both_sides_of_the_peak_force() -> None:
    for fraction, limited in ((0.999, False), (1.001, True)):
        bench = opened(keys="pose=home&limit_ma=3000,3000,3000&peak_force_n=1.5")
        bench.hold((HEADROOM * 1.5 * fraction, 0.0, 0.0), 3)
        assert ("force limited to the motors" in bench.counts) == limited
        assert bench.force_n[0] == pytest.approx(HEADROOM * 1.5 * min(1.0, fraction), abs=0.005)
        bench.close()


def test_what_acts_is_said_where_it_is_another_force() -> None:
    bench = opened()
    bench.read(0)
    assert bench.write((0.5, 0.0, 0.0)) is None
    assert bench.write((0.1, 0.0, 0.0)) == (0.5, 0.0, 0.0)  # it was asked already in this tick
    held = [0.1, 0.0, 0.0]
    bench.read(1)
    assert bench.write(held) is None
    held[0] = 0.3
    assert bench.write(held) == (0.1, 0.0, 0.0)  # what was sent, not what the caller made of it


@pytest.mark.parametrize("wrong", [nan, inf, -inf])
def test_no_current_for_what_is_no_number(wrong: float) -> None:
    bench = opened()
    bench.hold((0.5, 0.0, 0.0), 10)
    assert any(bench.arm.mechanics.currents_ma)
    bench.read(bench.tick)
    with pytest.raises(DeviceError, match="not finite; no current is sent instead"):
        bench.write((0.1, wrong, 0.0))
    assert bench.sent[-1].startswith(b"[0,0,0]")
    assert bench.arm.mechanics.force_n == NO_FORCE
    bench.tick += 1
    bench.hold((0.5, 0.0, 0.0), 3)
    assert any(bench.arm.mechanics.force_n)


@pytest.mark.parametrize("stated", NAMES)
@pytest.mark.parametrize("real", NAMES)
def test_a_device_must_be_what_it_is_said_to_be(stated: str, real: str) -> None:
    bench = Bench(real, f"pose=home&model={stated}")
    assert bench.capability.model == stated
    if stated == real:
        bench.open(RATE_HZ)
        bench.close()
        return
    with pytest.raises(DeviceError, match=f"it says that it is {real}, not {stated}; correct the key model"):
        bench.open(RATE_HZ)
    bench.line.open()  # it was let go


@every_model
def test_a_device_that_is_not_named_is_asked_once_and_refused_where_nobody_knows_it(name: str) -> None:
    bench = Bench(name)
    assert bench.sent == []
    for _ in range(2):
        assert bench.capability == MODELS[name].record
        assert len(bench.sent) == 1
    bench.open(RATE_HZ)
    bench = Bench(name)
    bench.arm.number = 7
    with refused("it says that it is number 7; known are polhem, vintage, woodenhaptics-serial"):
        _ = bench.capability
    bench.line.open()


@pytest.mark.parametrize("open_", [True, False])
def test_a_device_that_turns_into_another_one_gets_no_force_any_more(open_: bool) -> None:
    bench, said = opened(), "is woodenhaptics-serial now, and was vintage"
    bench.hold((0.5, 0.0, 0.0), 10)
    bench.arm.fault("model", 0.08)
    if open_:
        found, when, sizes = bench.fails((0.5, 0.0, 0.0), 100)
        assert said in found
        assert when <= 2
        assert not any(sizes[60:])
    bench.close()
    if not open_:
        with pytest.raises(DeviceError, match=said):
            bench.open(RATE_HZ)
        bench.arm.mend()
    bench.open(RATE_HZ)


def test_a_device_that_is_silent_has_no_current_after_50_ms() -> None:
    """It hears, but does not answer; where it is deaf too its own watchdog lets go."""
    bench = opened()
    bench.hold((0.5, 0.0, 0.0), 20)
    bench.arm.fault("silence")
    sizes = bench.fails((0.5, 0.0, 0.0), 200)[2]
    last = max(tick for tick, size in enumerate(sizes) if size)
    assert 30 < last < SILENT_S * RATE_HZ
    assert bench.counts["reply late"] == 199
    assert bench.counts["reply missed"] > 10
    bench.read(bench.tick)
    assert bench.write((0.5, 0.0, 0.0)) == (0.0, 0.0, 0.0)  # what acts
    bench.arm.mend()
    bench.hold((0.5, 0.0, 0.0), 15)
    assert hypot(*bench.arm.mechanics.force_n) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("when", ["idle", "reply outstanding", "silent"])
def test_closing_asks_twice_for_no_current(when: str) -> None:
    bench = opened()
    bench.hold((0.5, 0.0, 0.0), 10)
    if when == "silent":
        bench.arm.fault("silence")
    if when != "idle":
        bench.read(bench.tick)
        bench.write((0.5, 0.0, 0.0))
    before = len(bench.sent)
    bench.close()
    assert len(bench.sent) - before == GOODBYES == 2
    assert all(frame.startswith(b"[0,0,0]\n") for frame in bench.sent[before:])
    assert bench.arm.mechanics.currents_ma == (0, 0, 0)
    assert bench.arm.mechanics.force_n == NO_FORCE
    bench.close()
    assert len(bench.sent) - before == GOODBYES


def test_what_went_wrong_is_said_again_until_it_is_opened_anew() -> None:
    bench = opened()
    bench.hold((0.5, 0.0, 0.0), 5)
    bench.arm.fault("unplug")
    for _ in range(3):
        with pytest.raises(DeviceError, match="lost: it was unplugged; plug it in again, then re-arm"):
            bench.read(bench.tick)
        bench.write(NO_FORCE)  # waits for its turn
    bench.close()
    assert bench.counts["not reached when closed"] == 1
    with pytest.raises(DeviceError, match="is not there; plug it in"):
        bench.open(RATE_HZ)


@pytest.mark.parametrize("error", [1, 8, 512])
def test_complaints_of_the_firmware_are_counted_and_old_counts_are_no_sample(error: int) -> None:
    bench = opened()
    bench.hold(NO_FORCE, 5)
    bench.arm._act = lambda frame: error  # type: ignore[method-assign]
    samples = bench.hold(NO_FORCE, 10)[1:]
    assert [sample is None for sample in samples] == [error >= 8] * 9
    assert [name for name in bench.counts if name.endswith(f"(error {error})") and name.startswith("device: ")]


FAULTS = st.lists(st.tuples(st.sampled_from(VERBS), st.integers(1, 120), st.integers(0, 200)), min_size=1, max_size=6)


@given(
    plan=FAULTS,
    force=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    name=st.sampled_from(NAMES),
    hand=st.sampled_from(("hold", "tremor&tremor_m=0.002&direction=1,1,1", "reach&direction=0.5,-1,0.4")),
)
@hypothesis_settings(max_examples=120)
def test_whatever_fails_no_force_goes_beyond_its_limits_and_all_of_it_ends(plan, force, name: str, hand: str) -> None:
    """Any faults in any order: only DeviceError; currents within the limits; 110 ms after the last good reply no force."""
    bench = opened(name, hand=hand)
    bench.hold(force, 20)
    limits = bench.driver.model.drive.limit_ma
    for verb, milliseconds, ticks in plan:
        bench.arm.fault(verb, milliseconds / 1e3)
        for _ in range(ticks):
            bench.fails(force, 1)
            assert np.all(np.abs(bench.arm.mechanics.currents_ma) < limits)
    bench.close()
    bench.arm.advance(bench.arm.now_ns + 110_000_000)
    assert bench.arm.mechanics.force_n == NO_FORCE


@pytest.mark.parametrize(("pause", "rests"), [(80, False), (93, True), (110, True), (300, True)])
@every_model
def test_force_after_a_pause_in_which_the_watchdog_may_have_bitten_begins_at_none(
    name: str, pause: int, rests: bool
) -> None:
    """The board switches its motors on again at the next request, whatever that asks for: before, all of the old force."""
    bench = opened(name)
    force = (0.4, 0.0, 0.0)
    bench.hold(force, 400)
    assert bench.arm.enabled
    bench.tick += pause - 1
    said, _, sizes = bench.fails(force, 10)
    assert said == ""
    assert (max(sizes) < least_force_n(bench.arm) + 2e-3) == rests
    assert (bench.write(force) == NO_FORCE) == rests
    assert (bench.driver.weight_fraction < 0.1) == (rests or name != "polhem")
    bench.hold(force, 400)
    assert bench.force_n == pytest.approx(force, abs=least_force_n(bench.arm) + 2e-3)
