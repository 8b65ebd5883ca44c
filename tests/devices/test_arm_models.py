"""Arms by name: counts to forces and back, their limits, their keys.

Counts, positions and currents are those printed with the tables of haptikfabrikenapi (HID) and hfabapi (serial).
"""

from dataclasses import replace
from math import hypot, inf, nan, pi

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cogrip.devices import DeviceError
from cogrip.devices.arm.kinematics import joint_torque
from cogrip.devices.arm.model import ArmSettings
from cogrip.devices.arm.models import MODELS
from cogrip.devices.settings import keys_of, read_settings

from tests.devices.held_device import refused

WOODEN, SERIAL = MODELS["woodenhaptics"], MODELS["woodenhaptics-serial"]
VINTAGE, POLHEM = MODELS["vintage"], MODELS["polhem"]
every_model = pytest.mark.parametrize("name", MODELS)
count = st.integers(-40_000, 40_000)
counts_of_three = st.tuples(count, count, count)
current = st.floats(-20_000.0, 20_000.0)
force = st.tuples(*[st.floats(-30.0, 30.0)] * 3)


def position(model, *counts):
    return model.kinematics.forward(model.drive.angles(counts))


def exact_currents(model, angles, push):
    """Before limits and rounding [mA]."""
    return model.drive.currents(joint_torque(model.kinematics.jacobian(angles), push))


@pytest.mark.parametrize(
    ("model", "counts", "angles", "where"),
    [
        (WOODEN, (400, -300, 6200), (0.078540, -0.078540, 1.623156), (0.007875, 0.017934, 0.217190)),
        (WOODEN, (0, 0, 6000), (0.0, 0.0, pi / 2), (0.025, 0.0, 0.205)),
        (SERIAL, (400, -300, -5800), (0.078540, 0.078540, 1.518436), (0.039945, 0.020458, 0.191546)),
        (VINTAGE, (400, 7400, 200), (-0.069813, 1.509596, -0.040800), (-0.005151, -0.009290, -0.006466)),
        (VINTAGE, (0, 7700, 0), (0.0, pi / 2, 0.0), (0.0, 0.0, -0.015)),
    ],
)
def test_printed_counts_angles_and_positions(model, counts, angles, where) -> None:
    assert model.drive.angles(counts) == pytest.approx(angles, abs=1e-6)
    assert position(model, *counts) == pytest.approx(where, abs=1e-6)
    assert tuple(map(round, model.drive.counts(model.kinematics.inverse(position(model, *counts))))) == counts


@pytest.mark.parametrize(
    ("push", "currents"),
    [((1.0, 0.0, 0.0), (0, 659.588, 0)), ((0.0, 1.0, 0.0), (591.216, 0, 0)), ((0.0, 0.0, 1.0), (0, 0, 788.288))],
)
def test_printed_currents_of_unit_forces_at_home(push, currents) -> None:
    home = WOODEN.drive.angles(WOODEN.home_counts)
    assert exact_currents(WOODEN, home, push) == pytest.approx(currents, abs=5e-4)
    assert WOODEN.currents(home, push) == (tuple(map(int, currents)), False)
    back = WOODEN.currents(home, tuple(-f for f in push))
    assert back == (tuple(-int(i) for i in currents), False)  # towards zero from below too


def test_printed_currents_of_the_vintage_phantom() -> None:
    angles = VINTAGE.drive.angles((400, 7400, 200))
    exact = exact_currents(VINTAGE, angles, (1.0, -2.0, 0.5))
    assert exact == pytest.approx((1217.513, -328.969, -693.543), abs=6e-4)
    free = VINTAGE.with_settings(ArmSettings(limit_ma=(2000.0, 2000.0, 2000.0)), "serial")
    assert free.currents(angles, (1.0, -2.0, 0.5)) == ((1217, -328, -693), False)
    # 1000 mA to begin with: nobody has stated what its motors take
    fraction = 999.0 / exact[0]
    assert VINTAGE.currents(angles, (1.0, -2.0, 0.5)) == (tuple(int(fraction * i) for i in exact), True)


def test_an_re40_at_3_a_gives_the_peak_force_measured_on_woodenhaptics() -> None:
    """9.9 N at the end of a forearm of 0.22 m (Forsslund et al., TEI 2015)."""
    drive = replace(WOODEN.drive, motor_nm_per_a=(0.0603,) * 3)
    assert drive.torque((0.0, 0.0, 3000.0))[2] / 0.22 == pytest.approx(9.9, abs=0.05)


@every_model
@given(counts=counts_of_three)
def test_counts_undo_angles(name, counts) -> None:
    drive = MODELS[name].drive
    assert drive.counts(drive.angles(counts)) == pytest.approx(counts, rel=1e-14)
    ratio = zip(counts, drive.direction, drive.counts_per_turn, drive.capstan_m, drive.body_m, strict=True)
    expected = [sense * 2.0 * pi * n / turn * capstan / body for n, sense, turn, capstan, body in ratio]
    assert drive.angles(counts) == pytest.approx(expected, rel=1e-14)


@every_model
@given(currents=st.tuples(current, current, current))
def test_torque_undoes_currents(name, currents) -> None:
    drive = MODELS[name].drive
    assert drive.currents(drive.torque(currents)) == pytest.approx(currents, rel=1e-14)
    ratio = zip(currents, drive.direction, drive.capstan_m, drive.body_m, drive.motor_nm_per_a, strict=True)
    expected = [0.001 * i * sense * k * body / capstan for i, sense, capstan, body, k in ratio]
    assert drive.torque(currents) == pytest.approx(expected, rel=1e-14)


@given(st.tuples(current, current, current), st.tuples(*[st.integers(1, 6000)] * 3))
def test_limited_currents_keep_their_direction_and_their_limits(currents, limits) -> None:
    drive = replace(WOODEN.drive, limit_ma=tuple(map(float, limits)), full_scale_ma=6000.0)
    whole, scaled = drive.limited(currents)
    assert scaled == any(abs(i) >= limit for i, limit in zip(currents, limits, strict=True))
    assert all(abs(i) < limit for i, limit in zip(whole, limits, strict=True))
    shares = [(m - 1) / abs(i) for i, m in zip(currents, limits, strict=True) if i and scaled]
    fraction = min([1.0, *shares])
    for given_i, taken in zip(currents, whole, strict=True):  # truncated towards zero
        assert abs(fraction * given_i) - 1.0 - 1e-9 <= abs(taken) <= abs(fraction * given_i) + 1e-9
        assert taken * given_i >= 0.0


@pytest.mark.parametrize(
    ("currents", "taken"),
    [
        ((1999.99, -1999.99, 1999.0), ((1999, -1999, 1999), False)),
        ((2000.0, -2000.0, 2000.0), ((1999, -1999, 1999), True)),
        ((-2000.0, 1.0, 0.0), ((-1999, 0, 0), True)),
        ((2001.0, 1000.0, -500.0), ((1999, 999, -499), True)),
        ((-4000.0, 1002.0, 4.0), ((-1999, 500, 1), True)),
        ((0.99, -0.99, 1999.99), ((0, 0, 1999), False)),
        ((nan, 1.0, 1.0), ((0, 0, 0), True)),
        ((1.0, inf, 1.0), ((0, 0, 0), True)),
    ],
)
def test_both_sides_of_the_current_limit(currents, taken) -> None:
    assert WOODEN.drive.limited(currents) == taken


@every_model
@given(push=force, where=st.tuples(*[st.floats(-0.5, 0.5)] * 3))
def test_force_is_given_as_asked_or_in_its_direction(name, push, where) -> None:
    """The currents make the force within its limits at the tip, less what truncation to 1 mA takes."""
    model = MODELS[name]
    angles = model.kinematics.inverse(tuple(model.reach_m * x for x in where))
    assume(angles is not None)
    jacobian = model.kinematics.jacobian(angles)
    currents, scaled = model.currents(angles, push)
    assert all(abs(i) < limit for i, limit in zip(currents, model.drive.limit_ma, strict=True))
    back = np.linalg.inv(np.array(jacobian).T)
    done = back @ model.drive.torque(currents)
    lost = np.abs(back) @ np.abs(model.drive.torque((1.0, 1.0, 1.0)))
    size = hypot(*push)
    if not scaled:
        assert np.all(np.abs(done - push) <= lost + 1e-9)
    else:
        fraction = np.dot(done, push) / size**2
        assert 0.0 <= fraction <= 1.0 + np.linalg.norm(lost) / size
        assert np.all(np.abs(done - fraction * np.array(push)) <= 2.0 * np.linalg.norm(lost) + 1e-9)
    assert np.linalg.norm(done) <= model.record.peak_force_n + np.linalg.norm(lost) + 1e-9


def test_both_sides_of_the_peak_force() -> None:
    strong = WOODEN.with_settings(ArmSettings(motor_nm_per_a=(1.0, 1.0, 1.0)), "hid")
    home = strong.drive.angles(strong.home_counts)
    at_limit, scaled = strong.currents(home, (5.0, 0.0, 0.0))
    assert not scaled
    assert strong.currents(home, (5.001, 0.0, 0.0)) == (at_limit, True)
    assert strong.currents(home, (3.0, 0.0, 4.0))[1] is False
    assert strong.currents(home, (3.0, 0.001, 4.0))[1] is True  # the length of the force, not its parts


def test_a_force_that_is_not_finite_or_a_linkage_that_does_not_close_gives_no_current() -> None:
    home = WOODEN.drive.angles(WOODEN.home_counts)
    for bad in (nan, inf, -inf):
        for push in ((bad, 1.0, 1.0), (1.0, bad, 1.0), (1.0, 1.0, bad)):
            assert WOODEN.currents(home, push) == ((0, 0, 0), True)
    with pytest.raises(DeviceError, match=r"polhem: joint angles \(0.0, 2.2, 2.0\) rad are out of reach.*calibrate"):
        POLHEM.currents((0.0, 2.2, 2.0), (1.0, 0.0, 0.0))


@every_model
def test_inside_is_the_sphere_about_the_origin(name) -> None:
    model = MODELS[name]
    for sense in ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.0, 0.8)):
        assert model.inside(tuple(0.999999 * model.reach_m * x for x in sense))
        assert not model.inside(tuple(1.000001 * model.reach_m * x for x in sense))
    assert not model.inside((nan, 0.0, 0.0))
    assert not model.inside((0.0, 0.0, inf))


def settings(**query) -> ArmSettings:
    return read_settings(ArmSettings, query, "serial:x")


@pytest.mark.parametrize(
    ("key", "low", "high"),
    [
        ("turn", 1.0, 1e6), ("capstan_m", 1e-4, 1.0), ("body_m", 1e-3, 10.0), ("motor_nm_per_a", 1e-4, 10.0),
        ("limit_ma", 2.0, 3000.0), ("home", -1e6, 1e6),
    ],
)  # fmt: skip
def test_both_sides_of_the_bounds_of_every_key(key, low, high) -> None:
    for good in (low, high):
        assert VINTAGE.with_settings(settings(**{key: f"{good!r},{good!r},{good!r}"}), "serial:x")
    for bad in (low - 1e-5, high * (1.0 + 1e-9), nan):
        with refused(f"serial:x: {key}=", f"give three numbers, each {low:g} to {high:g}"):
            VINTAGE.with_settings(settings(**{key: f"{low!r},{bad!r},{low!r}"}), "serial:x")
    with pytest.raises(DeviceError, match=f"{key}=1,1: give three numbers"):
        VINTAGE.with_settings(settings(**{key: "1,1"}), "serial:x")


def test_a_direction_is_one_or_minus_one() -> None:
    turned = VINTAGE.with_settings(settings(dir="1,-1,1"), "serial:x")
    assert turned.drive.angles((1, 1, 1)) == tuple(-t for t in VINTAGE.drive.angles((1, 1, 1)))
    for bad in ("1,0,1", "1,1,0.5", "2,1,1"):
        with pytest.raises(DeviceError, match=r"dir=.*give three numbers, each -1 or 1"):
            VINTAGE.with_settings(settings(dir=bad), "serial:x")


def test_current_limit_is_bounded_by_the_full_scale_and_follows_it_down() -> None:
    with pytest.raises(DeviceError, match="limit_ma=6000,6000,6000: give three numbers, each 2 to 3000"):
        WOODEN.with_settings(settings(limit_ma="6000,6000,6000"), "hid")
    six = WOODEN.with_settings(settings(limit_ma="6000,6000,6000", full_scale_ma="6000"), "hid")
    assert six.drive.limit_ma == (6000.0,) * 3
    assert six.drive.limited((7000.0, 0.0, 0.0)) == ((5999, 0, 0), True)
    three = WOODEN.with_settings(settings(limit_ma="3000,3000,3000"), "hid")
    assert three.drive.limited((7000.0, 0.0, 0.0)) == ((2999, 0, 0), True)
    assert SERIAL.with_settings(settings(limit_ma="6000,6000,6000"), "serial").drive.limit_ma == (6000.0,) * 3
    assert WOODEN.with_settings(settings(full_scale_ma="500"), "hid").drive.limit_ma == (500.0,) * 3
    for key, bad in (("full_scale_ma", ("1.9", "6001")), ("peak_force_n", ("0", "-1", "40.1", "nan"))):
        for value in bad:
            with pytest.raises(DeviceError, match=key):
                settings(**{key: value})


def test_a_model_without_keys_is_itself_and_every_key_arrives() -> None:
    assert POLHEM.with_settings(ArmSettings(), "serial") == POLHEM
    other = {"peak_force_n": 3.0, "full_scale_ma": 900.0, "dir": (1.0, 1.0, 1.0), "gravity": "off"}
    for key in keys_of(ArmSettings):
        value = other.get(key, (100.0, 200.0, 300.0) if key in ("turn", "limit_ma") else (0.5, 0.6, 0.7))
        if key != "pose":
            assert POLHEM.with_settings(ArmSettings(**{key: value}), "serial") != POLHEM, key


def test_the_record_follows_the_keys_to_the_safe_side() -> None:
    record = WOODEN.record

    def changed(**query):
        return WOODEN.with_settings(settings(**query), "hid").record

    assert changed(limit_ma="200,200,200").continuous_force_n == pytest.approx(0.1 * record.continuous_force_n)
    assert changed(limit_ma="2000,2000,500").continuous_force_n == pytest.approx(0.25 * record.continuous_force_n)
    assert changed(limit_ma="2999,2999,2999").continuous_force_n == record.continuous_force_n  # not for ever
    stronger = changed(motor_nm_per_a="0.0538,0.0538,0.0538").continuous_force_n
    assert stronger == pytest.approx(min(5.0, record.continuous_force_n * 0.0538 / 0.0259))
    assert changed(turn="2000,4000,1000").resolution_m == pytest.approx(2.0 * record.resolution_m)
    assert changed(peak_force_n="2").peak_force_n == 2.0
    assert changed(peak_force_n="2").continuous_force_n == 2.0
    assert changed(peak_force_n="8").continuous_force_n == record.continuous_force_n
