"""Damping and friction of emulated arms, identified by their own drivers: bounds that hold, and are worth something.

The emulated mechanism has viscous damping b and, on each axis, Coulomb friction c: at least b and c along any direction.
Virtual time.
"""

from functools import cache
from math import hypot, inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.supervised_device import SupervisedDevice
from cogrip.devices.arm import identification
from cogrip.devices.arm.identification import LossBounds, everywhere, fit, force_within, identify
from cogrip.devices.arm.pose import OwnLosses
from cogrip.devices.device import DeviceError
from cogrip.devices.registry import axes_of, make

from tests.client.seated_client import DEVICE_HZ, Client
from tests.extent import long

FREE = "hand=push&force_n=0"
VINTAGE = "damping_nspm=0.3&friction_n=0.04"
MOST_MA = 200.0


def free_arm(name: str, keys: str, hand: str = FREE) -> Any:
    address = f"emulated:{name}?{hand}&{keys}"
    return make(address, axes=axes_of(address))


def identified(device: Any) -> tuple[LossBounds, float]:
    """The bounds, and the force that was allowed."""
    model = device.driver.model
    force_n = force_within(model, inf if model.record.family == "haply" else MOST_MA)
    return identify(device, model, force_n), force_n


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the slowest of the three frequencies, which takes half of the time, and with shorter swings."""
    monkeypatch.setattr(identification, "FREQUENCIES_HZ", identification.FREQUENCIES_HZ[1:])
    monkeypatch.setattr(identification, "SETTLE_S", 0.5)
    monkeypatch.setattr(identification, "PERIODS", 2)


# (machine, b, c). In the middle 0.75 of the truth is found. Losses in the joints, which the driver must assume, might be
# less elsewhere: friction by r = 0.6 to 0.7, damping by r^2, and by up to 1.5 more where the joints' directions are oblique.
@pytest.mark.parametrize(
    ("name", "b", "c"),
    [
        long("vintage", 0.3, 0.04), long("vintage", 0.8, 0.02), long("woodenhaptics", 0.3, 0.04),
        long("woodenhaptics-serial", 1.0, 0.1), long("aluhaptics", 0.5, 0.05), long("2diy-metal", 0.5, 0.1),
        long("pantograph", 0.5, 0.15),
    ],
)  # fmt: skip
def test_the_bounds_hold_and_are_worth_something(name: str, b: float, c: float) -> None:
    found, _ = identified(free_arm(name, f"damping_nspm={b}&friction_n={c}"))
    assert 0.2 * b < found.damping_nspm <= b
    assert 0.5 * c < found.friction_n <= c


@pytest.mark.long
@given(st.floats(0.0, 1.0), st.floats(0.0, 0.08), st.floats(0.05, 0.15))
@settings(max_examples=8, deadline=None)
def test_the_bounds_hold_for_any_mechanism(b: float, c: float, mass_kg: float) -> None:
    found, _ = identified(free_arm("vintage", f"damping_nspm={b}&friction_n={c}&mass_kg={mass_kg}"))
    assert found.damping_nspm <= b
    assert found.friction_n <= c


@pytest.mark.long
@pytest.mark.parametrize("name", ["vintage", long("woodenhaptics"), long("2diy"), long("pantograph")])
@pytest.mark.usefixtures("quick")
def test_nothing_is_found_where_there_is_nothing(name: str) -> None:
    found, _ = identified(free_arm(name, "damping_nspm=0&friction_n=0"))
    assert found.friction_n == 0.0
    assert found.damping_nspm == 0.0


@cache
def watched_vintage() -> tuple[LossBounds, float, list[float], list[float]]:
    """Identify a vintage arm of 0.3 N s/m and 0.04 N; return its bounds, the bound of the force, and each force and current."""
    device = free_arm("vintage", VINTAGE)
    mechanics = device.firmware.mechanics
    sizes, currents = [], []
    drive = mechanics.drive

    def watched(currents_ma: tuple[float, float, float]) -> None:
        drive(currents_ma)
        sizes.append(hypot(*mechanics.force_n))
        currents.append(max(map(abs, currents_ma)))

    mechanics.drive = watched
    return *identified(device), sizes, currents


@pytest.mark.usefixtures("quick")
def test_the_bounds_hold_for_a_vintage_arm_whose_force_stays_within_its_own_and_ends_at_zero() -> None:
    found, force_n, sizes, currents = watched_vintage()
    assert 0.2 * 0.3 < found.damping_nspm <= 0.3
    assert 0.5 * 0.04 < found.friction_n <= 0.04
    assert 0.5 * force_n < max(sizes) < 1.05 * force_n
    assert max(currents) <= MOST_MA
    assert sizes[-1] == 0.0
    largest = [max(sizes[at : at + 20]) for at in range(len(sizes) - 200, len(sizes) - 20, 20)]
    assert largest[-1] < 0.2 * force_n, "it fades out"


@pytest.mark.sample(3)
@pytest.mark.parametrize(
    ("keys", "hand", "said"),
    [
        ("friction_n=0.3", FREE, r"moved 0\.0 mm a period under at most 0\.18 N, less than 10 mm: its friction or mass is too"),
        ("friction_n=0.04", "hand=hold", r"moved 1\.\d mm a period .*or it is held; nothing is kept"),
        ("friction_n=0", "hand=push&force_n=0.3&start_s=2", r"mm off at .* m/s, out of 30 mm and 0\.5 m/s: it is let go"),
        ("x0_m=0.08,0,0", FREE, r"the tip is at \(0\.080, .*too near the edge to swing 10 mm; put it in mid-range"),
        ("faults=silence@3", FREE, r"no reply for 50 ms: it is let go"),
        ("faults=jump@3", FREE, "encoder a jumped"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("quick")
def test_refusals_let_go(keys: str, hand: str, said: str) -> None:
    device = free_arm("vintage", keys, hand)
    with pytest.raises(DeviceError, match=said):
        identified(device)
    assert not any(device.firmware.mechanics.currents_ma)
    assert device.capability.own_friction_n == 0.0


@pytest.mark.long
@pytest.mark.usefixtures("quick")
def test_missed_ticks_cost_nothing_and_too_many_end_it() -> None:
    """The force was held meanwhile. The device's time goes by the ticks, so that it is as late as the loop."""
    exact, force_n, *_ = watched_vintage()
    device = free_arm("vintage", VINTAGE)

    def late_by(ticks: int) -> LossBounds:
        return identify(device, device.driver.model, force_n, lambda tick: tick + ticks * (tick % 700 == 0))

    late = late_by(12)
    assert late.damping_nspm == pytest.approx(exact.damping_nspm, rel=0.2)
    assert late.friction_n == pytest.approx(exact.friction_n, rel=0.1)
    assert late.friction_n <= 0.04
    device = free_arm("vintage", VINTAGE)
    with pytest.raises(DeviceError, match="the loop was away for 59 ms, above 50; see `cogrip doctor`"):
        late_by(60)
    assert not any(device.firmware.mechanics.currents_ma)


def test_an_arm_without_force_is_refused() -> None:
    with pytest.raises(DeviceError, match="gives no force, so nothing can be identified"):
        force_within(make("hid:woodenhaptics?variant=mbed8", axes=3).model, MOST_MA)  # type: ignore[attr-defined]


S = np.repeat([0.05, 0.09, 0.13], 3)
PATH = np.full(9, 0.04)


@given(st.floats(0.0, 2.0), st.floats(0.0, 0.2), st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_no_period_took_less_than_the_bounds_say(b: float, c: float, noise: list[float]) -> None:
    y = c + b * S + 0.001 * np.array(noise)
    found = fit(S, y, PATH, 0.2, 0.004, 3e-5)
    assert (found.friction_n + found.damping_nspm * S <= np.maximum(y, 0.0) + 1e-12).all()
    assert found.damping_nspm >= 0.0
    assert found.friction_n >= 0.0


def test_points_off_any_line_are_refused_and_those_on_one_are_not() -> None:
    y = 0.04 + 0.3 * S
    assert fit(S, y, PATH, 0.2, 0.004, 0.0) == LossBounds(pytest.approx(0.3), pytest.approx(0.036))
    with pytest.raises(DeviceError, match="more than 20%, or below 0; let nobody touch it"):
        fit(S, y * np.array([1.0, 1.6, 0.6] * 3), PATH, 0.2, 0.004, 0.0)
    with pytest.raises(DeviceError, match="below 0"):
        fit(S, -y, PATH, 0.2, 0.004, 0.0)
    fit(S, y, np.full(9, identification.LEAST_PATH_M), 0.2, 0.004, 0.0)
    with pytest.raises(DeviceError, match="less than 10 mm"):
        fit(S, y, np.full(9, 0.999 * identification.LEAST_PATH_M), 0.2, 0.004, 0.0)


def test_a_frequency_with_too_little_motion_is_left_out() -> None:
    y, path_m = 0.04 + 0.3 * S, PATH.copy()
    y[6:], path_m[6:] = 9.0, 0.009
    assert fit(S, y, path_m, 0.2, 0.004, 0.0) == LossBounds(pytest.approx(0.3), pytest.approx(0.036))
    path_m[5] = 0.009
    with pytest.raises(DeviceError, match=r"moved 9\.0 mm a period under at most 0.2 N, less than 10 mm"):
        fit(S, y, path_m, 0.2, 0.004, 0.0)


in_each_joint = st.lists(st.floats(0.01, 1.0), min_size=3, max_size=3)


@given(in_each_joint, in_each_joint, st.integers(0, 1000))
def test_losses_in_the_joints_are_bounded_in_every_direction(b: list[float], c: list[float], seed: int) -> None:
    """P = sum of B q'^2 + C |q'| by itself, against what the directions of the joints alone say."""
    random = np.random.default_rng(seed)
    jacobian = np.eye(3) + 0.4 * random.uniform(-1.0, 1.0, (3, 3))
    lengths = np.linalg.norm(jacobian, axis=0)
    found = [LossBounds(B / length**2, C / length) for B, C, length in zip(b, c, lengths, strict=True)]
    least = everywhere(found, jacobian / lengths, 1.0)
    velocity = random.normal(size=(200, 3))
    rates = velocity @ np.linalg.inv(jacobian).T
    speeds = np.linalg.norm(velocity, axis=1)
    assert (least.damping_nspm * speeds**2 <= rates**2 @ np.array(b) * (1 + 1e-9)).all()
    assert (least.friction_n * speeds <= np.abs(rates) @ np.array(c) * (1 + 1e-9)).all()


@pytest.mark.usefixtures("quick")
def test_what_was_identified_is_in_the_record_and_credited_by_the_device_port() -> None:
    device, found = free_arm("vintage", VINTAGE), watched_vintage()[0]
    assert device.store is not None
    client = Client()
    handle = SupervisedDevice(device, client.core, DEVICE_HZ)
    handle.open()
    assert device.capability.own_damping_nspm == device.capability.own_friction_n == 0.0
    handle.close()
    device.store.keep_losses(device.driver.losses(found.damping_nspm, found.friction_n, "today"))
    handle.open()
    assert device.capability.own_damping_nspm == found.damping_nspm > 0.1
    assert device.capability.own_friction_n == found.friction_n > 0.02
    port = client.core.port
    before, count_m = port.balance_j, device.capability.resolution_m
    port.end_frame((0.0,), (0.001 + count_m,), 1 / 128, inf)
    gained = port.balance_j - before
    assert gained == pytest.approx(0.001 * (found.damping_nspm * 0.001 * 128 + found.friction_n))
    handle.close()


def test_losses_found_with_other_motors_are_left_out_and_counted() -> None:
    device = free_arm("vintage", "seed=1")
    losses: OwnLosses = device.driver.losses(0.1, 0.02, "today")
    device.store.keep_losses(losses)
    assert device.capability.own_friction_n == 0.02
    other = free_arm("vintage", "motor_nm_per_a=0.03,0.03,0.03")
    other.store.keep_losses(losses)
    assert other.capability.own_friction_n == 0.0
    assert other.counts["own damping left out: identified with other settings"] == 1
