"""Identification of an arm's own damping and friction: lower bounds, for the energy ledger of the device port.

Nobody holds the arm. A force of at most F_m, a spring and a damper towards a reference (`SwingLaw`), swings the tip along one
direction u after the other, at several frequencies. Symbols: x tip [m], v its velocity [m/s], F force on the arm [N], m mass,
b damping [N s/m], c Coulomb friction [N], all along u; T tick [s], d displacement in a frame of M ticks [m].

    m v' + b v + c sign(v) = F          times v, over a whole period of the steady swing, whose ends are alike:

    W = sum F (x_{k+1} - x_k) = b int v^2 dt + c int |v| dt        so that        y = c + b s        (one point a period)

    y = W / int |v| dt,   s = int v^2 dt / int |v| dt,   int |v| dt = sum |d|,   int v^2 dt = sum |d|^2 / (M T)

No count is differentiated, the mass need not be known, and a constant force, such as a weight in part held, does no work. A
force that acts later, or a position that is older, than assumed makes y smaller: delays are on the safe side. F is in the
ledger's own units: if motors are stronger than their model says, ledger and bound are wrong by the same factor.

A line is fitted to the points of each direction (`fit`); its coefficients less 3 standard errors, and for c less the force
of a current's rounding, are the bounds there. The directions are those in which one joint moves alone, u_j (columns of the
Jacobian J, of length 1), and the axes. Losses are in the joints: with q_j the angle of joint j, B_j its damping and C_j its
friction, the lost power is P = sum of B_j q_j'^2 + C_j |q_j'|, q' = J^-1 v. With e_j the unit vector of joint j and b_j the
damping along u_j,

    friction  {u: sum C_j |q_j'| <= 1} has its corners at J e_j / C_j, so that the least friction is along one of the u_j
    damping   v^T D v with D = U^-T diag(b_j) U^-1, U = (u_1, u_2, ...), so that the least one is D's smallest eigenvalue
    elsewhere with J_p at another point p, q' is what it is here for the velocity J J_p^-1 v, of at least r |v|,
              r = min over p of 1 / |J_p J^-1|: friction is at least r c, damping r^2 b
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from cogrip.devices.arm.model import ArmModel
from cogrip.devices.device import Device, DeviceError

RATE_HZ = 1024
AMPLITUDE_M = 0.010
FREQUENCIES_HZ = (0.75, 1.5, 3.0)
SETTLE_S = 1.0  # least time before the periods that are measured; these begin and end where the tip turns
PERIODS = 3  # periods measured at each frequency
LEAVE = 0.25  # periods after the measured ones, in which the tip goes back to the middle
FADE_S = 0.25
FRAMES = 64  # frames of M ticks in a period: 0.1 % of path and of int v^2 dt is lost
REST_S = 0.5  # time without force before the first swing: what holds an arm's weight rises in 0.3 s
VELOCITY_TICKS = 16
ERROR_M = 0.005  # least distance from the reference at which the force is at its bound
MOST_RADPS = 40.0  # largest natural frequency of the spring on the record's mass: slow against the age of a sample
DAMPING_RATIO = 0.7
MOST_AWAY_M = 0.03  # The arm is let go where it is further from the middle than this, or faster than MOST_SPEED_MPS.
MOST_SPEED_MPS = 0.5
SILENT_S = 0.05
"""Longest time without a reply, or without a tick. Soon after it a driver, or the firmware, lets go by itself."""
SIGMAS = 3.0
LEAST_PATH_M = 0.010
"""Least path in a period that is used, a quarter of the reference's. Two frequencies or more must reach it."""
MOST_SCATTER = 0.2  # largest scatter of the points about their line, as a fraction of their mean
SAME = 0.99  # least cosine of the angle between two directions that count as one
GRID = 5  # points along each axis of the workspace

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LossBounds:
    """Lower bounds, over all directions, of the mechanism's own damping [N s/m] and friction [N]."""

    damping_nspm: float
    friction_n: float


def force_within(model: ArmModel, most_ma: float) -> float:
    """F_m [N]: no motor gets more than `most_ma` for it, nor more than half of what it can do for ever. Raises DeviceError."""
    if max(model.drive.largest_ma) <= 0.0:
        raise DeviceError(f"{model.record.model}: gives no force, so nothing can be identified: it is read only")
    return min(0.5, most_ma / max(model.drive.largest_ma)) * model.record.continuous_force_n


def identify(
    device: Device,
    model: ArmModel,
    force_n: float,
    wait: Callable[[int], int] = lambda tick: tick,
    progress: Callable[[str], None] = lambda text: None,
) -> LossBounds:
    """Swing the arm, which stands freely in mid-range with its pose known, and fit. It is opened and closed here.

    device    all axes of an arm of this model
    force_n   F_m
    wait      until a tick is due; gives the newest one that is, if later ones are due already
    Raises DeviceError where the arm fails, leaves its place, hardly moves, or does not follow the model.
    """
    record = device.capability
    rate_hz = min(RATE_HZ, record.rate_hz)
    device.open(rate_hz)
    try:
        tick, middle_m = _middle(device, rate_hz, wait)
        jacobian = _jacobian(model, middle_m)
        if jacobian is None or not all(model.inside(_three(at)) for at in _around(middle_m)):
            where = ", ".join(f"{value:z.3f}" for value in middle_m)
            raise DeviceError(
                f"the tip is at ({where}) m, too near the edge to swing {1e3 * AMPLITUDE_M:g} mm; put it in mid-range"
            )
        loop = _Loop(device, middle_m, SwingLaw(force_n, record.apparent_mass_kg), rate_hz, tick, wait)
        joints = jacobian / np.linalg.norm(jacobian, axis=0)
        axes = [axis for axis in np.eye(record.axes) if np.abs(axis @ joints).max() < SAME]
        rounding_n = _rounding_n(model, jacobian)
        found = []
        for number, direction in enumerate((*joints.T, *axes)):
            where = f"direction {number + 1} of {record.axes + len(axes)}"
            progress(f"{where}, at most {force_n:.2g} N: do not touch the arm")
            speed_mps, resistance_n, path_m = loop.swing(direction)
            found.append(fit(speed_mps, resistance_n, path_m, force_n, rounding_n, record.resolution_m))
        loop.fade()
    finally:
        device.close()
    return everywhere(found, joints, _least_ratio(model, jacobian))


def fit(
    speed_mps: Array, resistance_n: Array, path_m: Array, force_n: float, rounding_n: float, resolution_m: float
) -> LossBounds:
    """Lower bounds of b and c in y = c + b s: s `speed_mps`, y `resistance_n`, with the path of each period.

    rounding_n: what currents, rounded towards zero, may lack. A count of resolution_m is an error of W, the same in all periods
    of a frequency. Periods with too little motion are left out: a heavy arm hardly follows the fastest. Raises DeviceError
    where too few are left, and for a bad fit.
    """
    enough = path_m >= LEAST_PATH_M
    if enough.sum() < 2 * PERIODS:
        raise DeviceError(
            f"the tip moved {1e3 * np.sort(path_m)[-2 * PERIODS]:.1f} mm a period under at most {force_n:.2g} N, less than "
            f"{1e3 * LEAST_PATH_M:g} mm: its friction or mass is too large for that force, or it is held; nothing is kept"
        )
    speed_mps, resistance_n = speed_mps[enough], resistance_n[enough]
    design = np.column_stack([speed_mps, np.ones_like(speed_mps)])
    (b, c), *_ = np.linalg.lstsq(design, resistance_n, rcond=None)
    residual = resistance_n - design @ (b, c)
    variance = residual @ residual / (len(residual) - 2)
    mean = resistance_n.mean()
    floor_n = max(rounding_n, 0.02 * force_n)  # coarse counts alone scatter by so much
    if sqrt(variance) > max(MOST_SCATTER * mean, floor_n) or mean < -floor_n:
        raise DeviceError(
            f"the arm resists with {mean:.3g} N, +-{sqrt(variance):.2g} N about damping and friction: more than "
            f"{MOST_SCATTER:.0%}, or below 0; let nobody touch it, and see that nothing drags; nothing is kept"
        )
    variance += PERIODS * (resolution_m * force_n / path_m[enough].min()) ** 2
    error_b, error_c = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    b = max(0.0, b - SIGMAS * error_b)
    c = min(c - SIGMAS * error_c, (resistance_n - b * speed_mps).min()) - rounding_n
    if c < 0.0:  # the rounding may as well have been taken for damping
        b = max(0.0, min(b, b + c / speed_mps.min()))
    return LossBounds(float(b), max(0.0, float(c)))


def everywhere(found: Sequence[LossBounds], joints: Array, ratio: float) -> LossBounds:
    """The least of all directions and places. found: those of the joints' directions (columns of `joints`), then others."""
    back = np.linalg.inv(joints)
    own = np.diag([bounds.damping_nspm for bounds in found[: len(joints)]])
    damping = min(float(np.linalg.eigvalsh(back.T @ own @ back)[0]), *(bounds.damping_nspm for bounds in found))
    friction = min(bounds.friction_n for bounds in found)
    return LossBounds(max(0.0, ratio * ratio * damping), ratio * friction)


class SwingLaw:
    """A spring and a damper, of at most `force_n` together [N]."""

    def __init__(self, force_n: float, mass_kg: float) -> None:
        self._most_n = force_n
        self._stiffness_npm = min(force_n / ERROR_M, mass_kg * MOST_RADPS * MOST_RADPS)
        self._damping_nspm = 2.0 * DAMPING_RATIO * sqrt(self._stiffness_npm * mass_kg)

    def force(self, off_m: Sequence[float], slip_mps: Sequence[float]) -> tuple[float, ...]:
        """Force on the arm [N] where it is `off_m` behind its reference, and `slip_mps` slower."""
        k, b = self._stiffness_npm, self._damping_nspm
        wanted = [k * x + b * v for x, v in zip(off_m, slip_mps, strict=True)]
        fraction = min(1.0, self._most_n / (hypot(*wanted) or 1.0))
        return tuple([fraction * part for part in wanted])


class _Loop:
    """The device's loop from `tick` on, and what was seen in it since the direction began."""

    def __init__(
        self, device: Device, middle_m: Sequence[float], law: SwingLaw, rate_hz: int, tick: int, wait: Callable[[int], int]
    ) -> None:  # fmt: skip
        self._device, self._middle_m, self._law, self._rate_hz, self._wait = device, middle_m, law, rate_hz, wait
        self._tick = self._taken = self._begun = tick
        self._recent: deque[tuple[int, Sequence[float]]] = deque([(tick, middle_m)], VELOCITY_TICKS + 1)
        self._seen: list[tuple[int, Sequence[float]]] = []
        self._held: Sequence[float] = [0.0] * len(middle_m)
        self._forces: list[Sequence[float]] = []  # tick by tick

    def swing(self, direction: Array) -> Array:
        """s [m/s], y [N] and the path [m] of each measured period, shape (3, periods)."""
        self._begun, windows = self._tick, []
        self._seen, self._forces = [self._recent[-1]], []
        u = [float(part) for part in direction]
        for frequency_hz in FREQUENCIES_HZ:
            period = FRAMES * round(self._rate_hz / (FRAMES * frequency_hz))
            settle = ceil(SETTLE_S * frequency_hz) + 0.25  # periods
            start, omega = self._tick, 2.0 * pi / period
            while (at := self._next() - start) < round((settle + PERIODS + LEAVE) * period):
                grown = AMPLITUDE_M * min(1.0, at / period)
                self._act([grown * sin(omega * at) * part for part in u])
            first = start - self._begun + round(settle * period)
            windows += [(first + number * period, period) for number in range(PERIODS)]
        ticks = np.array([tick - self._begun for tick, _ in self._seen], dtype=float)
        positions = np.array([position for _, position in self._seen])
        every = np.arange(self._tick - self._begun)
        path = np.column_stack([np.interp(every, ticks, column) for column in positions.T])
        return self._points(path, np.array(self._forces), windows)

    def _points(self, path: Array, forces: Array, windows: Sequence[tuple[int, int]]) -> Array:
        rows = []
        for first, period in windows:
            places = path[first : first + period + 1]
            work_j = float((forces[first : first + period] * np.diff(places, axis=0)).sum())
            steps_m = np.linalg.norm(np.diff(places[:: period // FRAMES], axis=0), axis=1)
            path_m = float(steps_m.sum()) or 1e-9
            square = float(steps_m @ steps_m) * self._rate_hz * FRAMES / period
            rows.append((square / path_m, work_j / path_m, path_m))
        return np.array(rows).T

    def fade(self) -> None:
        """Hold the middle ever less: the force ends at zero."""
        start, ticks = self._tick, round(FADE_S * self._rate_hz)
        while (at := self._next() - start) < ticks:
            self._act([0.0] * len(self._middle_m), 1.0 - (at + 1) / ticks)

    def _next(self) -> int:
        """Wait for the next tick. Where others were missed, the last force was held. Raises DeviceError for too many."""
        due = self._wait(self._tick)
        if due - self._tick > SILENT_S * self._rate_hz:
            away_ms = 1e3 * (due - self._tick) / self._rate_hz
            raise DeviceError(f"the loop was away for {away_ms:.0f} ms, above {1e3 * SILENT_S:g}; see `cogrip doctor`")
        self._tick = due
        self._forces += [self._held] * (due - self._begun - len(self._forces))
        return due

    def _act(self, reference_m: Sequence[float], fraction: float = 1.0) -> None:
        """This tick: to `reference_m` from the middle. Raises DeviceError where the arm is to be let go."""
        sample = self._device.read(self._tick)
        if sample is not None:
            self._taken = self._tick - sample.age_ticks
            self._recent.append((self._taken, sample.position_m))
            self._seen.append(self._recent[-1])
        elif self._tick - self._taken > SILENT_S * self._rate_hz:
            raise DeviceError(f"no reply for {1e3 * SILENT_S:g} ms: it is let go; see `cogrip devices check`")
        (before, then), (now, position) = self._recent[0], self._recent[-1]
        elapsed_s = max(1, now - before) / self._rate_hz
        velocity = [(x - old) / elapsed_s for x, old in zip(position, then, strict=True)]
        away = [x - middle for x, middle in zip(position, self._middle_m, strict=True)]
        if hypot(*away) > MOST_AWAY_M or hypot(*velocity) > MOST_SPEED_MPS:
            raise DeviceError(
                f"the tip is {1e3 * hypot(*away):.0f} mm off at {hypot(*velocity):.2f} m/s, out of {1e3 * MOST_AWAY_M:g} mm "
                f"and {MOST_SPEED_MPS:g} m/s: it is let go; let nobody touch it, and hang up one that is not balanced"
            )
        off = [goal - x for goal, x in zip(reference_m, away, strict=True)]
        push = [fraction * part for part in self._law.force(off, [-v for v in velocity])]
        load = [-part for part in push]  # a device's force loads the hand: it pushes with -F
        acting = self._device.write(load)
        self._held = push if acting is None else [-part for part in acting]
        self._forces.append(self._held)
        self._tick += 1


def _middle(device: Device, rate_hz: int, wait: Callable[[int], int]) -> tuple[int, tuple[float, ...]]:
    """The next tick, and where the tip stands after REST_S without force. Raises DeviceError where nothing was read."""
    position, tick = None, 0
    while (tick := wait(tick)) < REST_S * rate_hz:
        sample = device.read(tick)
        position = position if sample is None else sample.position_m
        device.write((0.0,) * device.capability.axes)
        tick += 1
    if position is None:
        raise DeviceError(f"no reply for {1e3 * REST_S:g} ms: see `cogrip devices check`")
    return tick, position


def _three(position: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = (*position, 0.0, 0.0)[:3]
    return x, y, z


def _around(middle_m: Sequence[float]) -> list[tuple[float, ...]]:
    """Return the largest deviation along each axis."""
    steps = product((-MOST_AWAY_M, MOST_AWAY_M), range(len(middle_m)))
    return [tuple(x + step * (i == axis) for i, x in enumerate(middle_m)) for step, axis in steps]


def _jacobian(model: ArmModel, position: Sequence[float]) -> Array | None:
    """Return the value of as many joints as there are axes; None where the tip cannot be, or nearly not."""
    angles = model.kinematics.inverse(_three(position))
    rows = None if angles is None else model.kinematics.jacobian(angles)
    axes = len(position)
    return None if rows is None else np.array(rows)[:axes, :axes]


def _least_ratio(model: ArmModel, jacobian: Array) -> float:
    """r, over a grid of the workspace."""
    back, spans = np.linalg.inv(jacobian), [np.linspace(low, high, GRID) for low, high in model.record.workspace_m]
    there = [_jacobian(model, at) for at in product(*spans) if model.inside(_three(at))]
    return float(min(1.0 / np.linalg.norm(other @ back, 2) for other in (jacobian, *there) if other is not None))


def _rounding_n(model: ArmModel, jacobian: Array) -> float:
    """Force at the tip [N] of 1 mA in every motor: a driver rounds currents towards zero."""
    torque = np.diag([1.0 / per_nm for per_nm in model.drive.ma_per_nm[: len(jacobian)]])
    return float(np.linalg.norm(np.linalg.inv(jacobian).T @ torque, axis=0).sum())
