"""The stability of a session, and the largest stable stiffness.

Stable: every eigenvalue of the frame's map, but those that its structure puts at 1 (`rigid_motion`), lies inside the
unit circle (P eq. 36).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import Form
from cogrip.analysis.linear.rigid_motion import Rigid
from cogrip.analysis.linear.state_space import Array

SEARCHED_TO_NPM = 1e7
SEARCHED_FROM_NPM = 1.0
_STEPS_A_DECADE = 24
_BATCH = 8  # number of sizes of the grid at a time, where the first that is unstable ends the search
_PIECES, _SMALL = 9, 64
"""Number of parts of a bracket in a round, and most states with which it is so large: a matrix of more costs more than a
round."""
_CHUNK = 1024  # number of matrices at a time: more do not fit into a cache


@dataclass(frozen=True, slots=True)
class StabilityVerdict:
    """The stability of a session. spectral_radius: of the whole map, at least 1 where `structural` names an eigenvalue there;

    `decaying`: of the other eigenvalues.
    """

    form: Form
    spectral_radius: float
    decaying: float
    structural: tuple[str, ...]
    states: int

    @property
    def stable(self) -> bool:
        return self.decaying < 1.0


def verdict(model: LiftedModel) -> StabilityVerdict:
    """Return the verdict of a session's eigenvalues."""
    rigid = Rigid(model)
    decaying = float(_along(modes(model), np.ones(1))[0])
    whole = max(1.0, decaying) if rigid.names else decaying
    return StabilityVerdict(model.session.form, whole, decaying, rigid.names, model.states)


def radius(model: LiftedModel, stiffness_npm: Array) -> Array:
    """Return the spectral radius without the structural eigenvalues, shape (...), for K > 0 [N/m], (..., N)."""
    flat = stiffness_npm.reshape(-1, stiffness_npm.shape[-1])
    parts = [_decaying(model, chunk) for chunk in np.split(flat, range(_CHUNK, len(flat), _CHUNK))]
    return np.concatenate(parts).reshape(stiffness_npm.shape[:-1])


def _decaying(model: LiftedModel, stiffness: Array) -> Array:
    values = np.linalg.eigvals(Rigid(model, stiffness).removed(model.matrix(stiffness)))
    largest: Array = np.abs(values).max(axis=-1, initial=0.0)
    return largest


def modes(model: LiftedModel, direction: Sequence[float] | None = None) -> tuple[Mode, ...]:
    """Split the session along a ray of stiffnesses into independent parts; together they have its eigenvalues.

    Of N people alike in everything, the common mode sees one of them at an N-th of the object, and the N - 1 differential modes
    leave the object at rest: one of them at a wall. Each has an N-th of the states, and eigenvalues cost the cube of them.
    Where anybody differs the session itself is its only part.
    """
    session = model.session
    ray = np.array(session.stiffness_npm if direction is None else direction, dtype=float)
    first = replace(session.people[0], name="", stiffness_npm=0.0)
    alike = all(replace(person, name="", stiffness_npm=0.0) == first for person in session.people)
    if not alike or model.users == 1 or ray.min() < ray.max():
        return (Mode(model, ray),)
    one, ray = replace(session, people=session.people[:1]), ray[:1]
    against = Mode(LiftedModel(replace(one, fixed=True)), ray)
    if session.fixed:
        return (against,)
    mass, damping = session.object_mass_kg / model.users, session.object_damping_nspm / model.users
    return against, Mode(LiftedModel(replace(one, object_mass_kg=mass, object_damping_nspm=damping)), ray)


class Mode(NamedTuple):
    """A part of a session, and its share of the direction, shape (N',)."""

    model: LiftedModel
    ray: Array


@dataclass(frozen=True, slots=True)
class Limit:
    """The end of the stable range from 0 on; None: none up to `searched_to_npm`; 0: no stiffness is stable.

    `stable_again`: some stiffness beyond it is stable once more.
    """

    stiffness_npm: float | None
    searched_to_npm: float
    stable_again: bool = False


def largest_stable(
    model: LiftedModel,
    direction: Sequence[float] | None = None,
    relative: float = 1e-6,
    to_npm: float = SEARCHED_TO_NPM,
    beyond: bool = True,
) -> Limit:
    """Return the largest s such that K_i = s direction_i [N/m] is stable, and every smaller s too.

    direction: shape (N,); default: the session's stiffnesses in proportion to the largest. Searched on a logarithmic grid from
    SEARCHED_FROM_NPM to `to_npm`, then bisected to `relative`. beyond: also search for what is `stable_again`, which takes the
    whole grid; without it the first unstable one ends the search. Raises ValueError for a direction without length.
    """
    ray = np.array(model.session.stiffness_npm if direction is None else direction, dtype=float)
    if not (ray >= 0.0).all() or not ray.max() > 0.0:
        raise ValueError(f"direction {ray.tolist()} must have a part above 0 and none below: give K of somebody")
    parts = modes(model, (ray / ray.max()).tolist())
    to_npm = max(to_npm, SEARCHED_FROM_NPM)
    decades = np.log10(to_npm / SEARCHED_FROM_NPM)
    sizes = np.geomspace(SEARCHED_FROM_NPM, to_npm, int(np.ceil(round(decades * _STEPS_A_DECADE, 6))) + 1)
    stable = np.empty(0, dtype=bool)
    batch = len(sizes) if beyond else _BATCH
    for start in range(0, len(sizes), batch):
        stable = np.append(stable, _along(parts, sizes[start : start + batch]) < 1.0)
        if not beyond and not stable.all():
            break
    if stable.all():
        return Limit(None, to_npm)
    first = int(np.argmin(stable))
    again = bool(stable[first:].any()) and beyond
    if first == 0:
        return Limit(0.0, to_npm, again)
    low, high = float(sizes[first - 1]), float(sizes[first])
    pieces = _PIECES if max(part.model.states for part in parts) <= _SMALL else 2
    while high - low > relative * high:
        between = np.linspace(low, high, pieces + 1)[1:-1]
        inside = _along(parts, between) < 1.0
        count = len(between) if inside.all() else int(np.argmin(inside))
        low, high = (low, *between.tolist(), high)[count], (low, *between.tolist(), high)[count + 1]
    return Limit(low, to_npm, again)


def optimistic_limit(model: LiftedModel, sizes_npm: Sequence[float]) -> Limit:
    """Return an upper bound of `largest_stable`: of these few sizes, rising, the first that is unstable."""
    stable = _along(modes(model), np.array(sizes_npm) / max(model.session.stiffness_npm)) < 1.0
    return Limit(None if stable.all() else float(sizes_npm[int(np.argmin(stable))]), float(sizes_npm[-1]))


def _along(parts: Sequence[Mode], sizes: Array) -> Array:
    """Return the spectral radius at each size of the direction, (k,)."""
    largest: Array = np.max([_decaying(model, sizes[:, None] * ray) for model, ray in parts], axis=0)
    return largest
