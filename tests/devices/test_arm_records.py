"""The records of the arms, worked out again: force, resolution and mass from geometry, drives and links."""

from dataclasses import replace
from functools import cache
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest

from cogrip.devices.arm.models import MODELS
from cogrip.devices.arm.polhem import Polhem

WOODEN, VINTAGE, POLHEM = (MODELS[name] for name in ("woodenhaptics", "vintage", "polhem"))
every_model = pytest.mark.parametrize("name", MODELS)


def steps(model, angles) -> list[float]:
    """Return the tip's motion per count of each joint [m]."""
    columns = zip(*model.kinematics.jacobian(angles), strict=True)
    return [hypot(*column) * abs(step) for column, step in zip(columns, model.drive.rad_per_count, strict=True)]


def test_resolution_at_home_per_count_is_the_printed_one() -> None:
    for model, printed_mm in ((WOODEN, (0.048, 0.054, 0.064)), (VINTAGE, (0.024, 0.028, 0.023))):
        found_mm = np.multiply(1e3, steps(model, model.drive.angles(model.home_counts)))
        assert found_mm == pytest.approx(printed_mm, abs=5e-4)


def worst_force_n(model) -> float:
    """Force by the current limits in the worst direction at the worst reachable place: a grid through the sphere's shells.

    Of a motor that holds weight too, what is left beside it.
    """
    angles, lengths_m = reached(model.kinematics, model.reach_m)
    held_ma = np.array([model.weight_currents(at, 1.0)[0] for at in angles]) if model.holds_weight else 0.0
    return ((model.drive.limit_ma - np.abs(held_ma)) / np.abs(model.drive.ma_per_nm) / lengths_m).min()


@cache
def reached(kinematics, reach_m: float) -> tuple[list[tuple[float, ...]], np.ndarray]:
    """Angles all over the shells, and the lengths of the Jacobian's columns: along one its motor must give most."""
    found = []
    for shell in (0.3, 0.6, 0.9, 0.95, 1.0):
        r = shell * reach_m * (1.0 - 1e-9)
        for north in np.linspace(-pi / 2, pi / 2, 91).tolist():
            for east in np.linspace(-pi, pi, 121).tolist():
                angles = kinematics.inverse((r * cos(north) * cos(east), r * cos(north) * sin(east), r * sin(north)))
                jacobian = None if angles is None else kinematics.jacobian(angles)
                if jacobian is not None:
                    found.append((angles, [hypot(*column) for column in zip(*jacobian, strict=True)]))
    return [angles for angles, _ in found], np.array([lengths_m for _, lengths_m in found])


@pytest.mark.sample(2)
@every_model
def test_stated_continuous_force_is_what_the_limits_give_at_the_worst_place(name) -> None:
    model = MODELS[name]
    worst = min(worst_force_n(model), model.record.peak_force_n)
    assert 0.97 * worst <= model.record.continuous_force_n <= worst


@pytest.mark.long
def test_worst_place_gives_the_printed_newtons_an_ampere() -> None:
    assert worst_force_n(WOODEN) / 2.0 == pytest.approx(1.27, abs=0.005)
    assert worst_force_n(VINTAGE) / 1.0 == pytest.approx(0.90, abs=0.011)  # printed from a coarser grid
    assert worst_force_n(replace(POLHEM, holds_weight=False)) / 2.0 == pytest.approx(0.828, abs=0.005)


@every_model
def test_stated_resolution_is_the_coarsest_step_at_the_centre(name) -> None:
    model = MODELS[name]
    coarsest = max(steps(model, model.kinematics.inverse((0.0, 0.0, 0.0))))
    assert coarsest <= model.record.resolution_m <= 1.01 * coarsest


RE30, RE40 = 34e-7, 140e-7
ROTORS = dict.fromkeys(MODELS, (RE30,) * 3) | {"woodenhaptics-v2019": (RE40,) * 3, "polhem": (RE40, RE30, RE30)}
"""Rotor inertia [kg m^2], Maxon catalogue, nominal."""


def centres(arm, angles) -> list[tuple[float, float, float]]:
    """(mass [kg], distance from the turret's axis, height [m]) of every link."""
    _, b, c = angles
    if not isinstance(arm, Polhem):
        weights, upper = arm.weights, arm.links_m[0]
        x, z = upper * sin(b) + weights.c_m * sin(c), upper * cos(b) - weights.c_m * cos(c)
        return [(weights.b_kg, weights.b_m * sin(b), weights.b_m * cos(b)), (weights.c_kg, x, z)]
    l0, l1, l2, _, l4, _ = arm.lengths_m
    lam = arm.forearm(angles)
    elbow, crank = (l0 / 2 + l1 * cos(b), l1 * sin(b)), (-l0 / 2 + l2 * cos(c), l2 * sin(c))
    rod = atan2(elbow[1] - l4 * sin(lam) - crank[1], elbow[0] - l4 * cos(lam) - crank[0])
    bodies = arm.bodies
    links = (
        (bodies.upper, (l0 / 2, 0.0), b),
        (bodies.crank, (-l0 / 2, 0.0), c),
        (bodies.rod, crank, rod),
        (bodies.forearm, elbow, lam),
    )
    turned = ((link, at, link.along_m, link.across_m, cos(t), sin(t)) for link, at, t in links)
    return [(link.mass_kg, x + u * co - v * si, z + u * si + v * co) for link, (x, z), u, v, co, si in turned]


def smallest_mass_kg(model, rotors) -> float:
    """1 / the largest eigenvalue of J M^-1 J^T at the centre, M of links as points and of rotors through the cables."""
    angles = model.kinematics.inverse((0.0, 0.0, 0.0))
    drive, step = model.drive, 1e-6
    inertia = np.diag(np.multiply(rotors, np.divide(drive.body_m, drive.capstan_m) ** 2))

    def places(at) -> np.ndarray:
        return np.array([(r * cos(at[0]), r * sin(at[0]), z) for _, r, z in centres(model.kinematics, at)])

    rates = [(places(angles + row) - places(angles - row)) / (2.0 * step) for row in step * np.eye(3)]
    for link, (mass, _, _) in enumerate(centres(model.kinematics, angles)):
        speed = np.array([rate[link] for rate in rates])
        inertia += mass * speed @ speed.T
    jacobian = np.array(model.kinematics.jacobian(angles))
    return 1.0 / np.linalg.eigvalsh(jacobian @ np.linalg.inv(inertia) @ jacobian.T)[-1]


@every_model
def test_stated_apparent_mass_is_the_smallest_of_links_and_rotors(name) -> None:
    model = MODELS[name]
    smallest = smallest_mass_kg(model, ROTORS[name])
    if name == "vintage":  # the data sheet's, which is no more than what it would come to
        assert model.record.apparent_mass_kg == 0.075 <= smallest_mass_kg(model, (10.5e-7,) * 3)
    else:
        assert 0.95 * smallest <= model.record.apparent_mass_kg <= smallest


@every_model
def test_records_are_complete_and_agree_with_their_models(name) -> None:
    model, record = MODELS[name], MODELS[name].record
    assert record.model == name
    assert record.axes == 3 == len(record.workspace_m)
    assert record.workspace_m == ((-model.reach_m, model.reach_m),) * 3
    assert 0.0 < record.continuous_force_n <= record.peak_force_n == 5.0
    assert (record.gives_velocity, record.latency_ticks, record.speed_mps, record.slew_nps) == (False, 1, 1.5, 1e3)
    assert record.rate_hz == 1024
    assert all(0.0 < limit <= model.drive.full_scale_ma for limit in model.drive.limit_ma)
    assert model.kinematics.forward(model.drive.angles(model.home_counts)) is not None
