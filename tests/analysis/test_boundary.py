"""The traced outline against a dense grid, against symmetry, and on both of its sides."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cogrip.analysis.linear.boundary import ASIDE
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import ModelError, form_overrides, linear_session
from cogrip.analysis.linear.region import Region, dense_grid, grid_axes, regions, stiffnesses
from cogrip.analysis.linear.stability import largest_stable, radius
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings

from tests.extent import long

Array = NDArray[np.float64]
DELAYS = (0, 1, 2, 4)
ALIKE: dict[str, Any] = {"users": [{"name": "a"}, {"name": "b"}]}
UNALIKE: dict[str, Any] = {
    "object": {"mass_kg": 0.35, "damping_nspm": 0.4},
    "users": [
        {"name": "a", "device_mass_kg": 0.07, "impedance_nspm": 15.0, "damping_nspm": 4.0},
        {"name": "b", "device_mass_kg": 0.3, "device_damping_nspm": 0.5, "impedance_nspm": 30.0},
    ],
}


TABLES = {"alike": ALIKE, "unalike": UNALIKE}


def settings_of(table: dict[str, Any], scheme: Any) -> Settings:
    return resolve(table, form_overrides(scheme))


@cache
def traced(table: str, scheme: str) -> tuple[list[Region], tuple[float, float]]:
    """Return the regions at all DELAYS, and the box that holds them."""
    return regions(settings_of(TABLES[table], scheme), DELAYS, estimated=False)


def border_of(stable: NDArray[np.bool_]) -> Array:
    """Return the middles of edges between stable and unstable cells, as shares of the box, (n, 2) with K_1 first."""
    cells = len(stable)
    rows, columns = np.nonzero(stable[:, 1:] != stable[:, :-1])
    upright = np.column_stack(((columns + 1.0) / cells, (rows + 0.5) / cells))
    rows, columns = np.nonzero(stable[1:] != stable[:-1])
    level = np.column_stack(((columns + 0.5) / cells, (rows + 1.0) / cells))
    return np.concatenate((upright, level))


def distances(points: Array, line: Array) -> Array:
    """Return the distance of each point from a polyline."""
    start, along = line[:-1], np.diff(line, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-30)
    share = np.clip(((points[:, None] - start) * along).sum(axis=2) / square, 0.0, 1.0)
    gap = points[:, None] - (start + share[..., None] * along)
    least: Array = np.hypot(gap[..., 0], gap[..., 1]).min(axis=1)
    return least


@pytest.mark.parametrize(
    ("table", "scheme", "delays", "cells"),
    [
        ("unalike", "coupling", (1,), 120),
        long("alike", "paper", DELAYS, 120),
        long("unalike", "paper", DELAYS, 200),
        long("unalike", "coupling", DELAYS, 200),
    ],
)
def test_the_boundary_lies_within_half_a_percent_of_that_of_a_dense_grid(
    table: str, scheme: str, delays: tuple[int, ...], cells: int
) -> None:
    """The border that a grid shows is known to half a cell: a quarter of a percent, or four tenths."""
    found, box = traced(table, scheme)
    for region in found:
        assert region.boundary.verified
        assert not region.boundary.open.any()
        if region.delay_frames not in delays:
            continue
        grid = dense_grid(LiftedModel(region.session), box, cells)
        edges = border_of(grid < 1.0)
        assert distances(edges, region.boundary.points_npm / box).max() < 0.005
        # and the other way round: from every point of the outline to the nearest edge, which is half a cell long each way
        nearest = np.abs(region.boundary.points_npm[:, None] / box - edges).max(axis=2).min(axis=1)
        assert nearest.max() < 0.005


@pytest.mark.parametrize("scheme", ["paper", "coupling"])
def test_just_inside_is_stable_and_just_outside_is_not(scheme: str) -> None:
    found, box = traced("unalike", scheme)
    for region in found:
        model = LiftedModel(region.session)
        points = region.boundary.points_npm
        assert (points < np.array(box)).all(), "the box holds every boundary"
        assert (radius(model, stiffnesses(region.session, points * (1.0 - ASIDE))) < 1.0).all()
        assert (radius(model, stiffnesses(region.session, points * (1.0 + ASIDE))) > 1.0).all()


def test_two_people_alike_have_a_region_alike() -> None:
    found, _ = regions(settings_of(ALIKE, "paper"), (1,), to_npm=(4000.0, 4000.0), estimated=False)
    points = found[0].boundary.points_npm
    np.testing.assert_allclose(points, points[::-1, ::-1], rtol=1e-6)


def test_the_diagonal_point_is_the_largest_stable_stiffness() -> None:
    for region in traced("alike", "paper")[0]:
        points = region.boundary.points_npm
        middle = points[np.abs(points[:, 0] - points[:, 1]).argmin()]
        limit = largest_stable(LiftedModel(region.session)).stiffness_npm
        np.testing.assert_allclose(middle, limit, rtol=1e-4)


def test_the_passive_scheme_is_stable_to_the_edge_of_the_picture() -> None:
    found, box = regions(settings_of(UNALIKE, "passive"), DELAYS, to_npm=(1e5, 1e5), grid_cells=12, estimated=False)
    for region in found:
        assert region.boundary.open.all()
        assert region.boundary.verified
        assert (region.grid < 1.0).all()
        np.testing.assert_allclose(region.boundary.points_npm.max(axis=0), box)


def test_a_region_that_goes_on_beyond_the_box_is_open_there() -> None:
    found, _ = regions(settings_of(ALIKE, "paper"), (0,), to_npm=(2500.0, 2500.0), estimated=False)
    boundary = found[0].boundary
    assert boundary.open[0]
    assert boundary.open[-1]
    assert not boundary.open[len(boundary.open) // 2]
    assert boundary.verified


def test_a_third_person_keeps_their_stiffness() -> None:
    table = {"users": [{"name": "a"}, {"name": "b"}, {"name": "c", "stiffness_npm": 123.0}]}
    session = linear_session(settings_of(table, "paper"), estimated=False)
    K = stiffnesses(session, np.array([[1.0, 2.0], [3.0, 4.0]]))
    assert K.tolist() == [[1.0, 2.0, 123.0], [3.0, 4.0, 123.0]]
    found, _ = regions(settings_of(table, "paper"), (1,), estimated=False)
    assert found[0].boundary.verified


def test_the_grid_has_the_first_person_across_and_the_second_one_up() -> None:
    found, box = regions(settings_of(UNALIKE, "paper"), (1,), to_npm=(3000.0, 1500.0), grid_cells=7, estimated=False)
    k1, k2 = grid_axes(box, 7)
    grid = found[0].grid
    model = LiftedModel(found[0].session)
    assert grid[5, 2] == pytest.approx(radius(model, np.array([[k1[2], k2[5]]]))[0], abs=1e-12)


@pytest.mark.parametrize(
    ("table", "options", "words"),
    [
        ({"users": [{"name": "a"}]}, {}, "two people"),
        (ALIKE, {"to_npm": (0.0, 100.0)}, "above 0"),
        (ALIKE, {"grid_cells": -1}, "out of 0"),
        ({**ALIKE, "object": {"kind": "faces"}}, {}, "does not fit"),
    ],
)
def test_what_has_no_region_is_refused(table: dict[str, Any], options: dict[str, Any], words: str) -> None:
    with pytest.raises(ModelError, match=words):
        regions(settings_of(table, "paper"), (0,), **options)
