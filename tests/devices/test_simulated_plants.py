"""The machines' mechanics: exact where exactness is promised, passive always, with numbers known beforehand."""

from math import exp
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings
from cogrip.devices.simulated.phantom import WORKSPACE_M, PhantomPlant, PhantomSettings

from tests.devices.held_device import opened


def decimals(low: float, high: float) -> st.SearchStrategy[float]:
    """Floats of six decimals: no subnormal ones, at which solve_ivp itself divides by zero."""
    return st.floats(low, high).map(lambda number: round(number, 6))


masses = st.floats(0.02, 2.0)
dampings = st.floats(0.0, 20.0)
stiffnesses = st.floats(0.0, 3000.0)
forces = st.floats(-20.0, 20.0)


@given(
    mass=decimals(0.02, 2.0),
    dampings=st.tuples(*[decimals(0.0, 20.0)] * 2),
    stiffness=decimals(0.0, 3000.0),
    forces=st.tuples(*[decimals(-20.0, 20.0)] * 2),
    x=decimals(-0.2, 0.2),
    v=decimals(-2.0, 2.0),
    rate=st.sampled_from([128, 1000, 1024, 8000]),
)
@settings(max_examples=50, deadline=None)
def test_ideal_step_solves_the_differential_equation(mass, dampings, stiffness, forces, x, v, rate) -> None:
    """Damping of the machine and of the hand; drive of the hand and force of the device."""
    (damping, hand_damping), (drive, force) = dampings, forces
    plant = IdealPlant(IdealSettings(mass_kg=mass, damping_nspm=damping), 1)
    plant.open(rate, stiffness, hand_damping, [x])
    plant.velocity_mps[0] = v

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], (drive - force - stiffness * y[0] - (damping + hand_damping) * y[1]) / mass]

    exact = solve_ivp(slope, (0.0, 3 / rate), [x, v], method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    for _ in range(3):
        plant.step([drive], [force])
    assert plant.position_m[0] == pytest.approx(exact[0], rel=1e-8, abs=1e-10)
    assert plant.velocity_mps[0] == pytest.approx(exact[1], rel=1e-8, abs=1e-8)


def test_golden_free_fall() -> None:
    """m = 0.1 kg under F = -0.981 N: x = g t^2 / 2, v = g t; 4.905 m and 9.81 m/s after one second."""
    device = opened("sim:ideal?hand=push&force_n=0&mass_kg=0.1")
    device.read(0)
    device.write([-0.981])
    sample = device.read(1024)
    assert sample.position_m[0] == pytest.approx(4.905, rel=1e-12)
    assert sample.velocity_mps[0] == pytest.approx(9.81, rel=1e-12)


def test_golden_viscous_start_and_compliance() -> None:
    """m = 0.1 kg, b = 2 N s/m pushed with 1 N: v = (1 - exp(-20 t)) / 2; a hand of 300 N/m sinks by F / 300."""
    device = opened("sim:ideal?hand=push&force_n=1&damping_nspm=2", rate_hz=1000)
    device.read(100)
    assert device.velocity_mps[0] == pytest.approx((1.0 - exp(-2.0)) / 2.0, rel=1e-12)
    device = opened("sim:ideal?hand=hold&x0_m=0.01")
    device.write([3.0])
    device.read(4096)
    assert device.position_m[0] == pytest.approx(0.01 - 3.0 / 300.0, abs=1e-9)


def test_friction_holds_what_is_below_it_to_the_bit() -> None:
    random = Random(5)
    for _ in range(200):
        plant = PhantomPlant(PhantomSettings(), 1)
        plant.open(1024, random.uniform(0.0, 500.0), 5.0, [0.0])
        drive = random.uniform(-0.04, 0.04)
        for _ in range(50):
            plant.step([drive], [0.0])
        assert plant.position_m == [0.0]
        assert plant.velocity_mps == [0.0]


@pytest.mark.parametrize(("speed", "rate"), [(0.1, 1024), (-0.2, 1024), (0.1, 8192), (0.25, 500)])
def test_friction_stops_a_slide_after_m_v2_over_2c(speed: float, rate: int) -> None:
    plant = PhantomPlant(PhantomSettings(), 1)
    plant.open(rate, 0.0, 0.0, [0.0])
    plant.velocity_mps[0] = speed
    for _ in range(rate):
        plant.step([0.0], [0.0])
    assert plant.velocity_mps[0] == 0.0
    expected = 0.075 * speed * abs(speed) / (2 * 0.04)
    assert plant.position_m[0] == pytest.approx(expected, abs=abs(speed) / rate / 2)


def test_motors_saturate_and_count_it() -> None:
    loaded, limit = (PhantomPlant(PhantomSettings(), 1) for _ in range(2))
    for plant, force in ((loaded, -30.0), (limit, -8.5)):
        plant.open(1024, 0.0, 0.0, [0.0])
        for _ in range(10):
            plant.step([0.0], [force])
    assert loaded.position_m == limit.position_m
    assert (loaded.saturated, limit.saturated) == (10, 0)


def test_end_stops_hold_and_let_go() -> None:
    device = opened("sim:phantom?hand=push&force_n=0", axes=3)
    device.write([-5.0, 5.0, -5.0])
    device.read(500)
    stops = (WORKSPACE_M[0][1], WORKSPACE_M[1][0], WORKSPACE_M[2][1])
    assert device.position_m == stops
    assert device.velocity_mps == (0.0, 0.0, 0.0)
    device.write([5.0, -5.0, 5.0])
    device.read(520)
    assert all(abs(x) < abs(stop) for x, stop in zip(device.position_m, stops, strict=True))


def test_encoder_reads_whole_counts_next_to_the_truth() -> None:
    device = opened("sim:phantom?hand=reach&amplitude_m=0.05")
    for tick in range(1500):
        sample = device.read(tick)
        counts = sample.position_m[0] / 3e-5
        assert abs(counts - round(counts)) < 1e-6
        assert abs(sample.position_m[0] - device.position_m[0]) <= 1.5e-5 + 1e-12
        assert sample.velocity_mps is None


@given(
    mass=masses,
    friction=st.floats(0.0, 2.0),
    damping=dampings,
    stiffness=stiffnesses,
    start=st.floats(-0.127, 0.127),
    speed=st.floats(-2.0, 2.0),
    inputs=st.lists(st.tuples(forces, forces), min_size=1, max_size=60),
    rate=st.sampled_from([500, 1024, 8192]),
)
@settings(max_examples=300, deadline=None)
def test_phantom_never_adds_energy(mass, friction, damping, stiffness, start, speed, inputs, rate) -> None:
    """Per tick: kinetic energy and the hand's spring gain no more than the held forces' work (u - F) dx."""
    plant = PhantomPlant(PhantomSettings(mass_kg=mass, friction_n=friction, damping_nspm=damping), 1)
    plant.open(rate, stiffness, 0.0, [start])
    plant.velocity_mps[0] = speed

    def stored() -> float:
        return 0.5 * mass * plant.velocity_mps[0] ** 2 + 0.5 * stiffness * plant.position_m[0] ** 2

    for drive, force in inputs:
        before, x = stored(), plant.position_m[0]
        plant.step([drive], [force])
        given_force = min(8.5, max(-8.5, force))
        work = (drive - given_force) * (plant.position_m[0] - x)
        assert stored() - before <= work + 1e-11 * (1.0 + before + abs(work))
        assert WORKSPACE_M[0][0] <= plant.position_m[0] <= WORKSPACE_M[0][1]


@given(mass=masses, stiffness=stiffnesses, inputs=st.lists(forces, min_size=1, max_size=30))
@settings(max_examples=50, deadline=None)
def test_phantom_without_friction_or_stops_is_ideal(mass, stiffness, inputs) -> None:
    phantom = PhantomPlant(PhantomSettings(mass_kg=mass, friction_n=0.0, peak_force_n=100.0), 1)
    ideal = IdealPlant(IdealSettings(mass_kg=mass), 1)
    for plant in (phantom, ideal):
        plant.open(8192, stiffness, 5.0, [0.0])
        for force in inputs:
            plant.step([0.0], [force])
    assert phantom.position_m[0] == pytest.approx(ideal.position_m[0], rel=1e-12, abs=1e-15)
    assert phantom.velocity_mps[0] == pytest.approx(ideal.velocity_mps[0], rel=1e-12, abs=1e-15)


@pytest.mark.parametrize(
    ("machine", "axes"),
    [
        ("ideal", 1),
        ("phantom?friction_n=0&resolution_m=0&handle_mass_kg=0", 3),
        ("gripper?friction_n=0", 4),
        ("freeflyer", 6),
        ("phantom6?friction_n=0", 6),
    ],
)
def test_a_device_that_is_let_go_has_no_hand_left(machine: str, axes: int) -> None:
    """Until then it is that of a hand that holds on, to the bit; then no spring and no drive act, and its own damping stays."""
    join = "&" if "?" in machine else "?"
    hand = "hand=waypoints&times_s=0,0.4&x_m=0,0.05"
    holding, freed = (
        opened(f"sim:{machine}{join}{hand}{let_go}", axes, 1024) for let_go in ("", f"&let_go_s={102.0 / 1024!r}")
    )
    for tick in range(1, 103):
        assert freed.read(tick) == holding.read(tick)
    plant = freed.plant
    speed = plant.velocity_mps[0]
    assert speed > 0.05
    own = freed.capability.own_damping_nspm / freed.capability.apparent_mass_kg
    for tick in range(103, 203):
        freed.read(tick)
    assert plant.velocity_mps[0] == pytest.approx(speed * exp(-own * 100 / 1024), rel=1e-6)
    assert plant.velocity_mps[1:] == pytest.approx([0.0] * (axes - 1), abs=1e-9)
    freed.close()
    freed.open(1024)  # as after a fault: the hand is back
    for tick in range(1, 103):
        freed.read(tick)
    assert plant.velocity_mps[0] == pytest.approx(speed, rel=1e-9)
