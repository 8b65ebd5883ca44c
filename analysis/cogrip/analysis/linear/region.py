"""The stable region in the plane of two people's stiffnesses, at several delays (P Fig. 4 and 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cogrip.analysis.linear.boundary import Boundary, trace
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearSession, ModelError, linear_session
from cogrip.analysis.linear.stability import largest_stable, radius
from cogrip.analysis.linear.state_space import Array
from cogrip.protocol.settings.sections import Settings

EVERYWHERE_NPM = 20_000.0  # side of a picture in which nothing is unstable
MOST_CELLS = 2000
PAIR = 2


@dataclass(frozen=True, slots=True)
class Region:
    """One delay's boundary; `grid`, if asked for: the spectral radius at the cells' centres, (rows of K_2, columns of K_1)."""

    delay_frames: float
    session: LinearSession
    boundary: Boundary
    grid: Array | None


def regions(
    settings: Settings,
    delays_frames: Sequence[float],
    *,
    to_npm: tuple[float, float] | None = None,
    grid_cells: int = 0,
    hands: bool = False,
    estimated: bool = True,
) -> tuple[list[Region], tuple[float, float]]:
    """Return boundaries for users 0 and 1 at each delay, and their box [N/m]: `to_npm`, or one that holds them all.

    Further users keep their own stiffness. Raises ModelError for a session of one, or an impossible box or grid.
    """
    if len(settings.users) < PAIR:
        raise ModelError(
            "a region has the stiffnesses of two people for axes, and there is one: add a second [[users]]"
        )
    if not 0 <= grid_cells <= MOST_CELLS:
        raise ModelError(f"a grid of {grid_cells} cells a side is out of 0 to {MOST_CELLS}")
    sessions = [
        linear_session(settings, delay_frames=frames, hands=hands, estimated=estimated) for frames in delays_frames
    ]
    return traced(sessions, delays_frames, to_npm=to_npm, grid_cells=grid_cells)


def traced(
    sessions: Sequence[LinearSession],
    delays_frames: Sequence[float],
    *,
    to_npm: tuple[float, float] | None = None,
    grid_cells: int = 0,
) -> tuple[list[Region], tuple[float, float]]:
    """Return the boundary of each session, called by its delay, and their box as `regions` does."""
    models = [LiftedModel(_springy(session)) for session in sessions]
    box = to_npm or _box(models)
    if not all(0.0 < side < np.inf for side in box):
        raise ModelError(f"a region up to {box[0]:g} by {box[1]:g} N/m has no area: give two numbers above 0")
    found = [
        Region(frames, session, trace(model, box, partial(stiffnesses, session)), dense_grid(model, box, grid_cells))
        for frames, session, model in zip(delays_frames, sessions, models, strict=True)
    ]
    return found, box


def dense_grid(model: LiftedModel, box_npm: tuple[float, float], cells: int) -> Array | None:
    """Return the spectral radius at the centres of cells x cells cells of a box [N/m], (K_2, K_1); None for no cells."""
    if not cells:
        return None
    k1, k2 = grid_axes(box_npm, cells)
    pairs = np.stack(np.meshgrid(k1, k2), axis=-1)
    return radius(model, stiffnesses(model.session, pairs))


def grid_axes(box_npm: tuple[float, float], cells: int) -> tuple[Array, Array]:
    """Return the centres of the cells along K_1 and K_2 [N/m]."""
    centres = (np.arange(cells) + 0.5) / cells
    return centres * box_npm[0], centres * box_npm[1]


def stiffnesses(session: LinearSession, pairs_npm: Array) -> Array:
    """Return K of all users, (..., N), with users 0 and 1 at `pairs_npm`, (..., 2)."""
    others = _springy(session).stiffness_npm[PAIR:]
    return np.concatenate((pairs_npm, np.broadcast_to(others, (*pairs_npm.shape[:-1], len(others)))), axis=-1)


def _springy(session: LinearSession) -> LinearSession:
    """Return the session with at least 1 mN/m for everybody: at 0 a stretch would be a freedom."""
    people = [replace(person, stiffness_npm=max(person.stiffness_npm, 1e-3)) for person in session.people]
    return replace(session, people=tuple(people))


def _box(models: Sequence[LiftedModel]) -> tuple[float, float]:
    """Return a fifth more than the largest limit along either axis and the diagonal, over all delays."""
    most = 0.0
    for model in models:
        users = model.users
        for ray in ((1.0, 1e-4), (1e-4, 1.0), (1.0, 1.0)):
            limit = largest_stable(model, (*ray, *([1e-4] * (users - PAIR))), relative=1e-3)
            most = max(most, limit.stiffness_npm or 0.0)
    side = _round_up(1.2 * most) if most else EVERYWHERE_NPM
    return side, side


def _round_up(value: float) -> float:
    """Return the next 1, 1.5, 2, 2.5, 3, 4, 5, 6 or 8 times a power of ten."""
    size = 10.0 ** np.floor(np.log10(value))
    return float(next(step * size for step in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if step * size >= value))
