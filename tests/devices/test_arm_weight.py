"""The Polhem's own weight, which its motors hold as with its maker's software: on the hand, in the limits, in the ledger."""

from math import hypot

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cogrip.devices.arm.driver import FALL_S, RISE_S, SILENT_S, WeightCompensation

from tests.devices.arm_bench import NO_FORCE, RATE_HZ, Bench, least_force_n, opened
from tests.extent import long

RISE = round(RISE_S * RATE_HZ) + 1
HELD = RISE + 100  # and the hand has come to rest


def felt(bench: Bench) -> tuple[float, ...]:
    """Return what the arm pushes the hand with, motors and weight [N]."""
    return tuple(np.add(bench.arm.mechanics.force_n, bench.arm.mechanics.weight_n))


def test_it_rises_in_its_time_and_falls_in_its_time() -> None:
    weight = WeightCompensation(1000, active=True)
    shares = [weight.step(tick, failed=False) for tick in range(1, 400)]
    assert (shares[0], max(np.diff(shares))) == pytest.approx((0.001 / RISE_S,) * 2)
    assert shares[298] < 1.0 - 1e-9 < shares[299] <= shares[-1] == 1.0
    last = round(1000 * FALL_S)
    falling = [weight.step(399 + tick, failed=True) for tick in range(1, last + 1)]
    assert falling[-2] > 1e-9 >= falling[-1] >= 0.0
    assert weight.step(399 + 10 * last, failed=True) == 0.0


def test_ticks_that_were_skipped_make_it_fall_but_not_rise_in_one_step() -> None:
    weight = WeightCompensation(1000, active=True)
    assert weight.step(250, failed=False) == pytest.approx(0.001 / RISE_S)
    for tick in range(251, 600):
        weight.step(tick, failed=False)
    assert weight.step(599 + round(500 * FALL_S), failed=True) == pytest.approx(0.5)
    off = WeightCompensation(1000, active=False)
    assert [off.step(tick, failed=False) for tick in range(1000)] == [0.0] * 1000


def test_the_hand_does_not_carry_the_arm_unless_it_is_told_to() -> None:
    """Gravity compensation is on by default; with gravity=off the motors carry nothing of (-0.61, 0, 0.98) N."""
    held, off = opened("polhem"), opened("polhem", "pose=home&gravity=off")
    sizes = [hypot(*held.arm.mechanics.force_n) for _ in range(HELD) if held.hold(NO_FORCE, 1)]
    off.hold(NO_FORCE, HELD)
    for bench in (held, off):
        bench.read(bench.tick)
        assert bench.write(NO_FORCE) is None  # what was asked for acts
        assert bench.counts == {}
    least = least_force_n(Bench("polhem").arm)
    assert np.abs(np.diff(sizes)).max() < 1.2 / RISE + least, "of 1.15 N, which do not come in one step"
    assert held.arm.mechanics.force_n == pytest.approx((-0.608, 0.0, 0.975), abs=least)
    assert felt(held) == pytest.approx(NO_FORCE, abs=least)
    assert hypot(*held.position_m) < 3e-4
    assert off.arm.mechanics.force_n == NO_FORCE
    assert felt(off) == pytest.approx((0.6, 0.0, -0.97), abs=0.05)  # it has sunk a little
    assert off.position_m[2] < -2e-3


@pytest.mark.parametrize(("name", "keys"), [("polhem", "pose=none"), ("vintage", "pose=home")])
def test_nothing_is_held_without_a_known_pose_nor_where_the_maker_holds_nothing(name: str, keys: str) -> None:
    bench = opened(name, keys)
    bench.hold(NO_FORCE, HELD)
    assert bench.arm.mechanics.peak_force_n == bench.driver.weight_fraction * (name == "vintage") == 0.0


def test_a_limit_below_what_it_weighs_holds_it_in_part_and_says_so() -> None:
    """Weight compensation at the centre takes 423 mA of motor b."""
    weak, enough = (opened("polhem", f"pose=home&limit_ma={ma},{ma},{ma}") for ma in (300, 440))
    for bench in (weak, enough):
        bench.hold(NO_FORCE, HELD)
    assert weak.counts["weight of the arm held in part only"] > 0
    assert max(map(abs, weak.arm.mechanics.currents_ma)) == 299
    assert enough.counts == {}
    weak.hold((0.0, 0.0, -1.0), 3)  # more of the same motor, which has no more
    assert max(map(abs, weak.arm.mechanics.currents_ma)) <= 299
    assert weak.write((0.0, 0.0, -1.0))[2] == pytest.approx(0.0, abs=0.01)


@pytest.mark.long
@given(force=st.tuples(*[st.floats(-5.0, 5.0)] * 3), limit_ma=st.sampled_from((500, 1000, 2000)))
@hypothesis_settings(max_examples=40, deadline=None)
def test_the_force_that_acts_is_the_one_that_is_told_whatever_the_weight_takes(force, limit_ma: int) -> None:
    """On the hand: motors less weight are the force that `write` answers, in the direction asked for; currents keep limits."""
    limits = f"limit_ma={limit_ma},{limit_ma},{limit_ma}"
    bench = opened("polhem", f"pose=home&{limits}", hand="hold&hand_stiffness_npm=2000")
    bench.hold(NO_FORCE, RISE)
    for _ in range(40):
        bench.read(bench.tick)
        acting = bench.write(force) or force
        bench.tick += 1
    assert max(map(abs, bench.arm.mechanics.currents_ma)) < limit_ma
    tolerance = least_force_n(Bench("polhem").arm) + 0.03  # the hand moves: the angles are a tick old
    assert [-part for part in felt(bench)] == pytest.approx(acting, abs=tolerance)
    assert hypot(*acting) <= hypot(*force) + 1e-9
    assert np.dot(acting, force) >= (1.0 - 1e-9) * hypot(*acting) * hypot(*force)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("gravity", "booked_well"), [("maker", True), long("off", False)])
def test_the_work_on_the_hand_is_what_the_ledger_books(gravity: str, booked_well: bool) -> None:
    """A hand that is led away by 40 mm and back: the booked force does all the work while the weight is held, to 0.2 mJ.

    With gravity=off the hand lifts the arm beside it: the difference is its potential energy, which it gives back.
    """
    hand = "reach&amplitude_m=0.04&direction=-0.5,0.4,0.8&delay_s=0.5&stop_s=2.1"
    bench = opened("polhem", f"pose=home&gravity={gravity}", hand=hand)
    bench.hold(NO_FORCE, 500)
    missing_j, most_j, last = 0.0, 0.0, bench.position_m
    for _ in range(3 * RATE_HZ):
        sample = bench.read(bench.tick)
        load = [20.0 * place for place in sample.position_m]
        acting = bench.write(load) or load
        bench.tick += 1
        bench.arm.advance(bench.tick * 10**9 // RATE_HZ)
        moved, last = np.subtract(bench.position_m, last), bench.position_m
        missing_j += float(-np.add(felt(bench), acting) @ moved)
        most_j = max(most_j, abs(missing_j))
    assert (most_j < 2e-4) == booked_well
    assert most_j > 0.03 or booked_well
    assert abs(missing_j) < 2e-4 + 0.05 * most_j  # back at the start


def test_a_device_that_has_failed_lets_go_of_the_weight_too() -> None:
    bench = opened("polhem")
    bench.hold(NO_FORCE, HELD)
    bench.arm.fault("jump")
    said, _, sizes = bench.fails(NO_FORCE, 100)
    assert "calibrate" in said
    falling = round(FALL_S * RATE_HZ)
    assert sizes[falling // 2] > 0.3
    assert max(sizes[round(SILENT_S * RATE_HZ) :]) == 0.0
    assert np.abs(np.diff(sizes)).max() < 0.1
    bench = opened("polhem")
    bench.hold(NO_FORCE, HELD)
    bench.close()
    assert bench.arm.mechanics.currents_ma == (0, 0, 0)
