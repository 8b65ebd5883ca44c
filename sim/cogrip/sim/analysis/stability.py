"""Is a session stable, and up to which stiffness?

Stable: every eigenvalue of the frame's map, but those that its structure puts at 1 (`rigid_motion`), lies inside the
unit circle (P eq. 36).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.rigid_motion import Rigid
from cogrip.sim.analysis.state_space import Array

SEARCHED_TO_NPM = 1e7
SEARCHED_FROM_NPM = 1.0
_STEPS_A_DECADE = 24
_CHUNK = 1024  # matrices at a time: more do not fit into a cache


@dataclass(frozen=True, slots=True)
class Verdict:
    """spectral_radius is that of the whole map: at least 1 where `structural` names an eigenvalue there;

    `decaying` is that of the rest.
    """

    scheme: str
    spectral_radius: float
    decaying: float
    structural: tuple[str, ...]
    states: int

    @property
    def stable(self) -> bool:
        return self.decaying < 1.0


def verdict(model: LiftedModel) -> Verdict:
    """What the eigenvalues of a session say."""
    rigid = Rigid(model)
    decaying = float(_radius(rigid.removed(model.matrix())))
    whole = max(1.0, decaying) if rigid.names else decaying
    return Verdict(model.session.scheme, whole, decaying, rigid.names, model.states)


def radius(model: LiftedModel, stiffness_npm: Array) -> Array:
    """Spectral radius without the structural eigenvalues, shape (...), for stiffnesses K [N/m], (..., N), all above 0."""
    flat = stiffness_npm.reshape(-1, stiffness_npm.shape[-1])
    parts = [_decaying(model, flat[start : start + _CHUNK]) for start in range(0, len(flat), _CHUNK)]
    return np.concatenate(parts).reshape(stiffness_npm.shape[:-1])


def _decaying(model: LiftedModel, stiffness: Array) -> Array:
    return _radius(Rigid(model, stiffness).removed(model.matrix(stiffness)))


def _radius(matrices: Array) -> Array:
    largest: Array = np.abs(np.linalg.eigvals(matrices)).max(axis=-1, initial=0.0)
    return largest


@dataclass(frozen=True, slots=True)
class Limit:
    """End of the stable stretch that begins at no stiffness; None: there is none up to `searched_to_npm`; 0: none is stable.

    `stable_again`: whether some stiffness beyond it is stable once more.
    """

    stiffness_npm: float | None
    searched_to_npm: float
    stable_again: bool = False


def largest_stable(model: LiftedModel, direction: Sequence[float] | None = None, relative: float = 1e-6) -> Limit:
    """The largest s such that K_i = s direction_i [N/m] is stable, and every smaller s too.

    direction: shape (N,); default: the session's stiffnesses in proportion to the largest. Looked for on a logarithmic grid
    from SEARCHED_FROM_NPM to SEARCHED_TO_NPM, then halved to `relative`. Raises ValueError for a direction without length.
    """
    ray = np.array(model.session.stiffness_npm if direction is None else direction, dtype=float)
    if not (ray >= 0.0).all() or not ray.max() > 0.0:
        raise ValueError(f"direction {ray.tolist()} must have a part above 0 and none below: give K of somebody")
    ray = ray / ray.max()
    decades = np.log10(SEARCHED_TO_NPM / SEARCHED_FROM_NPM)
    sizes = np.geomspace(SEARCHED_FROM_NPM, SEARCHED_TO_NPM, round(decades * _STEPS_A_DECADE) + 1)
    stable = _along(model, ray, sizes) < 1.0
    if stable.all():
        return Limit(None, SEARCHED_TO_NPM)
    first = int(np.argmin(stable))
    again = bool(stable[first:].any())
    if first == 0:
        return Limit(0.0, SEARCHED_TO_NPM, again)
    low, high = float(sizes[first - 1]), float(sizes[first])
    while high - low > relative * high:
        between = np.linspace(low, high, 10)[1:-1]
        inside = _along(model, ray, between) < 1.0
        count = len(between) if inside.all() else int(np.argmin(inside))
        low, high = (low, *between.tolist(), high)[count], (low, *between.tolist(), high)[count + 1]
    return Limit(low, SEARCHED_TO_NPM, again)


def _along(model: LiftedModel, ray: Array, sizes: Array) -> Array:
    return _decaying(model, sizes[:, None] * ray)
