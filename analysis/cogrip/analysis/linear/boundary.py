"""The boundary of the stable region in the plane of two stiffnesses, traced point by point (docs/decisions/0006).

Symbols: K = (K_1, K_2) stiffnesses of two users [N/m], up to `box` [N/m] each; G(theta), S(theta, K) response of clients with
their links, and of the server, at e^{j theta} a frame.

On it an eigenvalue e^{j theta} crosses the unit circle, f(theta, K) = det(I - S G) = 0 (`LiftedModel.characteristic`): two
real equations for theta and the distance s along a ray K = s box p(t), p(t) with t in [0, 1] the point of the unit square's
edge from (1, 0) round the corner to (0, 1). Newton solves them from the neighbouring ray's solution (D-decomposition,
Neimark 1949), and rays are put in between until chords fit. Eigenvalues verify every point on both sides; one that fails is
found anew by scanning its ray. The region is assumed to be star-shaped about the origin; `probes` between origin and
boundary would show it if it were not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.rigid_motion import Rigid
from cogrip.analysis.linear.state_space import Array

Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

LEAST_NPM = 1.0  # least size of a region: one that ends below it does not count
ASIDE = 1e-3  # distance from the boundary at which it is verified, as a share of s
_AXIS = 1e-4
"""Share of the other stiffness that a ray along an axis keeps: at 0 that spring's stretch would be a freedom."""
_FIRST_RAYS = 9
_LEVELS = 6
_CHORD = 2e-3
"""Distance of a new point from the chord of its neighbours, as a share of the box, above which more are asked for."""
_SCAN = np.geomspace(1e-3, 1.0, 13)
_NEWTON_STEPS = 10
_CONVERGED = 1e-5  # last step of an iteration that has converged: the error left is its square
_DIFFERENCE = 1e-7
_PROBES = (0.4, 0.8)
_LEAST_ANGLE = 1e-9  # least angle of a pole: at angle 0 are the poles of uniform motion

Spread = Callable[[Array], Array]
"""A function from stiffnesses of two users, (..., 2), to those of all, (..., N)."""


@dataclass(frozen=True, slots=True)
class Boundary:
    """Boundary points in the order of t, shape (P, 2) [N/m]; where `open` the region goes on beyond the box.

    inside, outside: spectral radius ASIDE before and behind each point; outside is nan where open.
    unstable_probes: unstable probes between origin and boundary: 0 unless the region has a hole.
    """

    points_npm: Array
    open: Flags
    inside: Array
    outside: Array
    unstable_probes: int

    @property
    def nowhere(self) -> bool:
        """True where no relevant stiffness is stable: the boundary traced then is the origin."""
        return bool((self.points_npm.max(axis=1) < LEAST_NPM).all())

    @property
    def verified(self) -> bool:
        """True if stable just inside and unstable just outside, everywhere; if unstable, where it is stable nowhere."""
        if self.nowhere:
            return bool((self.outside > 1.0).all())
        inside, outside = bool((self.inside < 1.0).all()), bool((self.outside[~self.open] > 1.0).all())
        return inside and outside and self.unstable_probes == 0


def trace(model: LiftedModel, box_npm: tuple[float, float], spread: Spread) -> Boundary:
    """Return the boundary of the region within a box [N/m]."""
    tracer = _Tracer(model, np.array(box_npm), spread)
    t = np.linspace(0.0, 1.0, _FIRST_RAYS)
    few = np.array([0, (_FIRST_RAYS - 1) // 2, _FIRST_RAYS - 1])
    known = tracer.scanned(t[few])
    others = np.delete(np.arange(_FIRST_RAYS), few)
    known = _merged(known, tracer.between(t[others], known))
    doubtful = np.ones(len(known.t) - 1, dtype=bool)
    for _ in range(_LEVELS):
        left = np.flatnonzero(doubtful)
        if not left.size:
            break
        middle = tracer.between(0.5 * (known.t[left] + known.t[left + 1]), known)
        far = tracer.off_chord(known, left, middle) > _CHORD
        added = np.zeros(len(known.t) + len(left), dtype=bool)
        added[np.searchsorted(known.t, middle.t) + np.arange(len(left))] = True
        halves = np.repeat(far, 2)
        known = _merged(known, middle)
        starts = np.flatnonzero(added)
        doubtful = np.zeros(len(known.t) - 1, dtype=bool)
        doubtful[np.column_stack((starts - 1, starts)).ravel()] = halves
    return tracer.boundary(known)


@dataclass(frozen=True, slots=True)
class _Rays:
    """Rays by t with the first crossing on each: s = inf where there is none in the box; angle theta of the eigenvalue."""

    t: Array
    s: Array
    angle: Array
    inside: Array
    outside: Array

    def replace(self, where: Flags, other: _Rays) -> None:
        for mine, theirs in zip(self.fields()[1:], other.fields()[1:], strict=True):
            mine[where] = theirs

    def fields(self) -> tuple[Array, ...]:
        return self.t, self.s, self.angle, self.inside, self.outside


def _merged(one: _Rays, other: _Rays) -> _Rays:
    order = np.argsort(np.concatenate((one.t, other.t)))
    return _Rays(*(np.concatenate(pair)[order] for pair in zip(one.fields(), other.fields(), strict=True)))


class _Tracer:
    def __init__(self, model: LiftedModel, box: Array, spread: Spread) -> None:
        self._model, self._box, self._spread = model, box, spread
        rigid = Rigid(model, spread(box[None]))
        self._rigid = rigid if rigid.for_any_stiffness else None

    def _end(self, t: Array) -> Array:
        """Return p(t) times the box, (..., 2)."""
        p = np.stack((np.minimum(1.0, 2.0 - 2.0 * t), np.minimum(1.0, 2.0 * t)), axis=-1)
        ends: Array = np.maximum(p, _AXIS) * self._box
        return ends

    def _critical(self, K: Array) -> tuple[Array, Array]:
        """Return spectral radius and angle of the eigenvalue that has it, for stiffnesses of the two (..., 2)."""
        stiffness = self._spread(K)
        rigid = self._rigid or Rigid(self._model, stiffness)
        values = np.linalg.eigvals(rigid.removed(self._model.matrix(stiffness)))
        sizes = np.abs(values)
        most = sizes.argmax(axis=-1)[..., None]
        angles = np.abs(np.angle(np.take_along_axis(values, most, axis=-1)))
        return np.take_along_axis(sizes, most, axis=-1)[..., 0], angles[..., 0]

    def scanned(self, t: Array) -> _Rays:
        """Find first crossings by eigenvalues along each whole ray: bracketed, then Newton, or bisection where that missed."""
        end = self._end(t)
        radius, angle = self._critical(_SCAN[:, None] * end[:, None, :])
        crossed = radius >= 1.0
        first = crossed.argmax(axis=1)
        rows = np.arange(len(t))
        low, high = np.where(first > 0, _SCAN[np.maximum(first - 1, 0)], 0.0), _SCAN[first]
        s, theta = np.full(len(t), np.inf), angle[rows, first]
        found = crossed.any(axis=1)
        if found.any():
            guess = np.sqrt(np.maximum(low, 0.1 * high) * high)
            s[found], theta[found] = self._newton(end[found], guess[found], theta[found])
        rays = self._verified(t, s, theta)
        missed = found & ~((s > low) & (s < high) & (rays.inside < 1.0) & (rays.outside > 1.0))
        if missed.any():
            middle, turn = self._halved(end[missed], low[missed], high[missed])
            rays.replace(missed, self._verified(t[missed], middle, turn))
        return rays

    def _halved(self, end: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Find the crossing in a bracket that is stable at its low end and not at its high one, by parts of eight."""
        rows = np.arange(len(end))
        angle = np.zeros(len(end))
        for _ in range(5):
            parts = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, 9)[1:]
            radius, angles = self._critical(parts[..., None] * end[:, None, :])
            first = (radius >= 1.0).argmax(axis=1)
            angle = angles[rows, first]
            low, high = np.where(first > 0, parts[rows, np.maximum(first - 1, 0)], low), parts[rows, first]
        return 0.5 * (low + high), angle

    def between(self, t: Array, known: _Rays) -> _Rays:
        """Find crossings on rays between known ones: Newton from both neighbours, the nearer one; scanned where it fails."""
        end = self._end(t)
        right = np.searchsorted(known.t, t)
        starts = np.stack((known.s[right - 1], known.s[right]))
        angles = np.stack((known.angle[right - 1], known.angle[right]))
        usable = np.isfinite(starts)
        tries = np.full(starts.shape, np.inf)
        if usable.any():
            ends = np.broadcast_to(end, (2, *end.shape))
            tries[usable], angles[usable] = self._newton(ends[usable], starts[usable], angles[usable])
        s, theta = tries.min(axis=0), np.where(tries[0] <= tries[1], angles[0], angles[1])
        s[s > 1.0] = np.inf
        rays = self._verified(t, s, theta)
        wrong = ~((rays.inside < 1.0) & ((rays.outside > 1.0) | np.isinf(s)))
        if wrong.any():
            rays.replace(wrong, self.scanned(t[wrong]))
        return rays

    def _newton(self, end: Array, s: Array, theta: Array) -> tuple[Array, Array]:
        """Solve f = 0 for (theta, log s) on each ray from a start; inf where it does not converge at s > 0."""
        x = np.stack((theta, np.log(s)))
        steps = np.array([[0.0, _DIFFERENCE, 0.0], [0.0, 0.0, _DIFFERENCE]])
        change = np.full_like(x, np.inf)
        with np.errstate(all="ignore"):
            for _ in range(_NEWTON_STEPS):
                tried = x[:, None, :] + steps[:, :, None]
                K = self._spread(np.exp(tried[1])[..., None] * end)
                f = self._model.characteristic(np.exp(1j * np.maximum(tried[0], _LEAST_ANGLE)), K)
                J = (f[1:] - f[0]) / _DIFFERENCE
                size = J[0].real * J[1].imag - J[1].real * J[0].imag
                change = -np.stack((
                    (f[0].real * J[1].imag - f[0].imag * J[1].real) / size,
                    (f[0].imag * J[0].real - f[0].real * J[0].imag) / size,
                ))  # fmt: skip
                x = x + np.clip(change, -0.5, 0.5)
                if np.nanmax(np.abs(change), initial=0.0) < _CONVERGED:
                    break
            converged = np.abs(change).max(axis=0) < _CONVERGED
        return np.where(converged, np.exp(x[1]), np.inf), np.abs(x[0])

    def _verified(self, t: Array, s: Array, theta: Array) -> _Rays:
        """Compute the radius on both sides of each crossing; at the end of the ray where there is none."""
        end = self._end(t)
        at = np.where(np.isfinite(s), s, 1.0)
        inner = np.where(np.isfinite(s), at * (1.0 - ASIDE), at)
        sides = np.stack((inner, at * (1.0 + ASIDE)))
        radius, _ = self._critical(sides[..., None] * end)
        outside = np.where(np.isfinite(s), radius[1], np.nan)
        return _Rays(t, s, theta, radius[0], outside)

    def off_chord(self, known: _Rays, left: Indices, middle: _Rays) -> Array:
        """Return the distance of new points from the chords between their neighbours, as a share of the box."""
        ends = [self._place(known.t[at], known.s[at]) for at in (left, left + 1)]
        along = ends[1] - ends[0]
        off = self._place(middle.t, middle.s) - ends[0]
        length = np.hypot(along[:, 0], along[:, 1])
        across = np.abs(along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0])
        distance: Array = np.divide(across, length, out=np.zeros_like(across), where=length > 0.0)
        return distance

    def _place(self, t: Array, s: Array) -> Array:
        """Return points on the boundary, (..., 2), as shares of the box."""
        return np.minimum(s, 1.0)[:, None] * self._end(t) / self._box

    def boundary(self, rays: _Rays) -> Boundary:
        """Return the traced boundary, with probes between it and the origin."""
        points = self._place(rays.t, rays.s) * self._box
        some = points[:: max(1, len(points) // 8)]
        probes = np.array(_PROBES)[:, None, None] * some
        radius, _ = self._critical(probes)
        return Boundary(points, np.isinf(rays.s), rays.inside, rays.outside, int((radius >= 1.0).sum()))
