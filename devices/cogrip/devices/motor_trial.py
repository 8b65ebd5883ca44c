"""Trial of motors before a person takes a seat: two short, weak pushes along all axes at once, in a hand or in none.

Each axis has a sequence of strokes of its own, so that what moves along one axis tells which motor moved it. The trial says
what is wrong where nothing else explains the motion as well, and that it knows nothing where something does.

Symbols: F_j force that loads the hand along axis j [N], x_i place along axis i [m], m apparent mass by the record [kg], B and K
damping [N s/m] and stiffness [N/m] of whoever holds the device, g_ij gain of the motion along i under F_j (1 for i = j and 0
else if all is well), l ticks by which samples are later than they say, p a polynomial of degree DEGREE: what the hand does.

    x_i(t) = sum_j g_ij y_j(t - l) + p(t)         m y_j'' + B y_j' + K y_j = -F_j

For each l, K and B of a grid the g_ij are those of least squares. A rest of at most DOUBT times the least one is as good an
answer; what all good answers say is known. The same is tried with sequences that were not pushed (DECOYS): where they explain
the motion nearly as well, something else made it, and nothing is known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement, product
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from cogrip.devices.device import Capability, Device
from cogrip.devices.response import AXES, MOST_N, Clock

Array = NDArray[np.float64]

MOST_HZ = 1024
STROKE_TICKS = 28
BEFORE_TICKS, AFTER_TICKS = 40, 40  # ticks without force before and after the strokes
WARMS_TICKS = 310  # An arm takes up its own weight in this time after it was opened.
SHARES = (0.05, 0.12)  # fractions of the peak force, all axes together: of the first push, and of the second at most
SAFE_M = 0.012  # largest motion by the second push, as foretold by that of the first
MOST_AWAY_M = 0.03  # distance from where a push began beyond which it ends
SILENT_TICKS = 20
STROKES = ("+-+-+---+++-", "+--+++----++", "+--++--++--+")
DECOYS = (
    ("+--+-++-+--+", "++--+--+--++", "++---+-+-+-+"),
    ("+---++++---+", "+-+-+-+---++", "++---+--+++-"),
)  # other courses of a push; each leaves the device where it was, at rest
STIFFNESSES_NPM = (
    0, 20, 40, 60, 90, 120, 160, 200, 250, 300, 350, 420, 500, 650, 800, 1000, 1300, 1700, 2200, 3000,
)  # fmt: skip
DAMPINGS_NSPM = (0.2, 0.5, 1, 1.5, 2, 3, 4, 5, 6, 8, 10, 13, 17, 22, 30)
DEGREE = 6
LATEST_TICKS = 9
DOUBT = 1.3
OTHERS = 0.2  # largest rest, as a fraction of the best decoy's, where the push has made the motion
QUIET = 0.12  # value of OTHERS where the push made nearly all of the motion, so that gain and delay can be told
HASTY = 0.1  # value of OTHERS where the hand goes further than STEADY_M meanwhile: its haste may look like a push
STEADY_M, SWINGS = 0.006, 3.0
CROSS = 0.5  # An axis is swapped where its own gain is less than this fraction of the largest gain.
MOST_GAIN = 1.5
TOLD_TICKS = 2  # largest l that is tolerated: some hands look like so many


@dataclass(frozen=True, slots=True)
class Tried:
    """Outcome of a trial. faults: what is wrong, each with its cure; unknown: what could not be told, and why.

    pushed_n  largest force along an axis [N]
    seen      whether sign and axis of every motion are known
    """

    pushed_n: float
    faults: tuple[str, ...]
    unknown: tuple[str, ...]
    seen: bool

    @property
    def text(self) -> str:
        """Return the outcome in one line."""
        if self.faults:
            return "; ".join(self.faults)
        words = [f"motors tried with {self.pushed_n:.2g} N"]
        if not self.unknown:
            words.append(f"signs, axes and gains as its record says, samples at most {TOLD_TICKS} ticks later")
        else:
            words += ["signs and axes as its record says"] if self.seen else []
            words.append(f"not determined: {'; '.join(self.unknown)}")
        return ": ".join([words[0], "; ".join(words[1:])])


@dataclass(slots=True)
class _Push:
    """Forces [N], shape (ticks, axes), and samples as (tick at which they were taken, place [m])."""

    forces: Array
    samples: list[tuple[int, Sequence[float]]]


@dataclass(frozen=True, slots=True)
class _Fit:
    """Rests [m^2], shape (lags, grid, axes), gains (lags, grid, i, j), least rest of each axis with decoys; pushed_n.

    slow_m  how far p goes along each axis, beyond what the push may have made of it by a swing in a loose hand
    """

    rests: Array
    gains: Array
    decoys: Array
    pushed_n: float
    slow_m: Array


def try_motors(device: Device, clock: Clock, rate_hz: int) -> Tried:
    """Push an open device, twice; no force is left. Raises DeviceError."""
    record = device.capability
    axes, zero = min(len(AXES), len(record.workspace_m)), (0.0,) * record.axes
    pushed_n = _share_n(SHARES[0], record, axes)
    pushes: list[_Push] = []
    tick = -1
    try:
        for _ in range(WARMS_TICKS):
            tick = clock(tick + 1)
            device.read(tick)
            device.write(zero)
        for share in SHARES:
            most_n = _share_n(share, record, axes)
            if pushes:
                pushed_n = min(most_n, pushed_n * SAFE_M / max(_travel_m(pushes[-1]), 1e-9))
                if pushed_n <= _share_n(SHARES[0], record, axes):  # no more to be learned
                    break
            push, tick = _push(device, clock, tick, pushed_n, axes)
            pushes.append(push)
    finally:
        device.write(zero)
    return judge([fit for push in pushes if (fit := _fitted(push, record, rate_hz))], record, axes)


def _share_n(share: float, record: Capability, axes: int) -> float:
    """Return the force along each axis [N] of a push with this share of the peak force."""
    return min(MOST_N, share * record.peak_force_n / sqrt(axes))


def _push(device: Device, clock: Clock, tick: int, pushed_n: float, axes: int) -> tuple[_Push, int]:
    """Push along all axes, each by its own strokes, and return what came of it, with the newest tick."""
    ticks, count = BEFORE_TICKS + len(STROKES[0]) * STROKE_TICKS + AFTER_TICKS, device.capability.axes
    forces, samples = np.zeros((ticks, axes)), list[tuple[int, Sequence[float]]]()
    begun: Sequence[float] | None = None
    first, done, silent, away = tick + 1, 0, 0, False
    while done < ticks:
        tick = clock(tick + 1)
        at = tick - first
        if at > done:  # held over ticks that were missed
            forces[done:at] = forces[done - 1] if done else 0.0
        if at >= ticks:
            break
        sample, silent = device.read(tick), silent + 1
        if sample is not None:
            place, silent = sample.position_m[:axes], 0
            begun = begun or place
            samples.append((at - sample.age_ticks, place))
            away = away or any(abs(x - y) > MOST_AWAY_M for x, y in zip(place, begun, strict=True))
        stroke = (at - BEFORE_TICKS) // STROKE_TICKS
        pushes = 0 <= stroke < len(STROKES[0]) and not away and silent < SILENT_TICKS
        asked = [pushed_n if strokes[stroke] == "+" else -pushed_n for strokes in STROKES[:axes]] if pushes else []
        acting = device.write((*asked, *(0.0,) * (count - len(asked))))
        forces[at] = (asked or 0.0) if acting is None else acting[:axes]
        done = at + 1
    return _Push(forces, samples), tick


def _slow(ticks: Array) -> Array:
    """Return an orthonormal basis of p at these ticks."""
    time = 2.0 * (ticks - ticks[0]) / (ticks[-1] - ticks[0]) - 1.0
    basis: Array = np.linalg.qr(np.vander(time, DEGREE + 1))[0]
    return basis


def _kept(push: _Push) -> tuple[NDArray[np.int64], Array] | None:
    """Return ticks and places, shape (samples, axes), that can be fitted; None where there are too few."""
    ticks = np.array([at for at, _ in push.samples], dtype=np.int64)
    kept = (ticks >= LATEST_TICKS) & (ticks < len(push.forces))
    if np.count_nonzero(kept) < len(push.forces) // 2:
        return None
    return ticks[kept], np.array([place for _, place in push.samples])[kept]


def _travel_m(push: _Push) -> float:
    """Return how far the device went to and fro, without what a hand does slowly [m]."""
    if (found := _kept(push)) is None:
        return np.inf
    ticks, places = found
    slow = _slow(ticks.astype(float))
    return float(np.ptp(places - slow @ (slow.T @ places), axis=0).max())


def _fitted(push: _Push, record: Capability, rate_hz: int) -> _Fit | None:
    """Fit the motion with what was pushed, and with decoys; None where there are too few samples, or nothing was pushed."""
    found, pushed_n = _kept(push), float(np.abs(push.forces).max())
    if found is None or not pushed_n:
        return None
    ticks, places = found
    slow = _slow(ticks.astype(float))
    hand = slow @ (slow.T @ places)
    places = places - hand
    floor = len(ticks) * max(record.resolution_m, 1e-7) ** 2 / 12.0
    rests, gains = _rests(push.forces, ticks, places, slow, record.apparent_mass_kg, rate_hz)
    decoys = [
        _rests(_decoy(strokes, push.forces, pushed_n), ticks, places, slow, record.apparent_mass_kg, rate_hz)[0]
        for strokes in DECOYS
    ]
    return _Fit(
        rests + floor,
        gains,
        np.min(decoys, axis=(0, 1, 2)) + floor,
        pushed_n,
        np.ptp(hand, axis=0) - SWINGS * np.ptp(places, axis=0),
    )


def _decoy(strokes: Sequence[str], forces: Array, pushed_n: float) -> Array:
    """Return forces that were not pushed."""
    decoy = np.zeros_like(forces)
    for axis, row in enumerate(strokes[: forces.shape[1]]):
        signs = np.repeat([1.0 if sign == "+" else -1.0 for sign in row], STROKE_TICKS)
        decoy[BEFORE_TICKS : BEFORE_TICKS + len(signs), axis] = pushed_n * signs
    return decoy


def _rests(
    forces: Array, ticks: NDArray[np.int64], places: Array, slow: Array, mass_kg: float, rate_hz: int
) -> tuple[Array, Array]:
    """Return what each l, K and B leaves of the motion, shape (lags, grid, axes), and the gains (lags, grid, i, j)."""
    motion = _answers(forces, mass_kg, rate_hz)
    _, axes, grid = motion.shape
    motion = motion.reshape(len(motion), axes * grid)  # of few long rows, as matrix products are fast then
    whole = (places**2).sum(axis=0)
    rests, gains = [], []
    for late in range(LATEST_TICKS + 1):
        made = motion[ticks - late]
        made -= slow @ (slow.T @ made)
        along = made.reshape(len(ticks), axes, grid)
        square = np.empty((grid, axes, axes))
        for i, j in combinations_with_replacement(range(axes), 2):
            square[:, i, j] = square[:, j, i] = np.einsum("tg,tg->g", along[:, i], along[:, j])
        square += 1e-9 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(axes)
        with_places = (made.T @ places).reshape(axes, grid, axes).transpose(1, 0, 2)
        found = np.linalg.solve(square, with_places)  # (grid, j, i)
        rests.append(np.maximum(whole - (found * with_places).sum(axis=1), 0.0))
        gains.append(found.transpose(0, 2, 1))
    return np.array(rests), np.array(gains)


def _answers(forces: Array, mass_kg: float, rate_hz: int) -> Array:
    """Return y of each K and B, shape (ticks, axes, grid): exact for forces that are held over a tick."""
    grid = np.array(list(product(STIFFNESSES_NPM, DAMPINGS_NSPM)))
    rates = np.zeros((len(grid), 3, 3))
    rates[:, 0, 1] = 1.0
    rates[:, 1] = -np.column_stack((grid, np.ones(len(grid)))) / mass_kg
    step = _exponential(rates / rate_hz)
    (xx, xv, xf), (vx, vv, vf) = np.ascontiguousarray(step[:, :2].transpose(1, 2, 0))
    motion = np.zeros((*forces.shape, len(grid)))
    x, v = np.zeros((2, forces.shape[1], len(grid)))
    for tick, row in enumerate(forces[..., None]):
        motion[tick] = x
        x, v = xx * x + xv * v + xf * row, vx * x + vv * v + vf * row
    return motion


def _exponential(matrices: Array) -> Array:
    """Return exp of each small matrix, shape (n, 3, 3): its series, after halvings, squared again."""
    halvings = max(0, int(np.ceil(np.log2(max(np.abs(matrices).max(), 1e-9)))) + 4)
    small = matrices / 2.0**halvings
    whole = term = np.broadcast_to(np.eye(3), matrices.shape)
    for order in range(1, 9):
        term = term @ small / order
        whole = whole + term
    for _ in range(halvings):
        whole = whole @ whole
    return whole


class _Answer:
    """Motion along one axis in one push. others: least rest as a share of that of the best decoy; made: by the push."""

    def __init__(self, fit: _Fit, axis: int) -> None:
        self.axis = axis
        rests = fit.rests[..., axis]
        self.others = float(rests.min() / fit.decoys[axis])
        self.made = self.others <= (OTHERS if fit.slow_m[axis] <= STEADY_M else HASTY)
        self.costs = rests / rests.min()
        self._gains = fit.gains[:, :, axis]
        good = self._gains[self.costs <= DOUBT]
        self._strongest = np.abs(good).argmax(axis=1)
        own, others = good[:, axis], np.abs(np.delete(good, axis, axis=1))
        self.right = bool(np.all(self._strongest == axis) and np.all(own > 0.0))
        self.turned = bool(np.all(self._strongest == axis) and np.all(own < 0.0))
        one = np.all(self._strongest == self._strongest[0]) and self._strongest[0] != axis
        self.swapped = bool(one and np.all(np.abs(own) < CROSS * others.max(axis=1)))

    @property
    def told(self) -> bool:
        """Return whether all good answers agree in axis and sign."""
        return self.right or self.turned or self.swapped

    def fault(self, names: Sequence[str]) -> str:
        """Return a wrong axis or sign in words, "" where there is none."""
        name = names[self.axis]
        if self.swapped:
            other = names[self._strongest[0]]
            return f"a push along {other} moves the device along {name}: these axes are swapped, of motors or positions"
        if self.turned:
            wrong = "the sign of its motor or of its position there is wrong; a damper would drive the hand"
            return f"{name}: it moves against its force: {wrong}"
        return ""

    def sizes(self, late: NDArray[np.int64]) -> Array:
        """Return the gains of the good answers with these lags."""
        costs = self.costs[late]
        sizes: Array = np.abs(self._gains[late][costs <= max(DOUBT, 1.15 * costs.min())][:, self._strongest[0]])
        return sizes


def _clearest(answers: Sequence[_Answer]) -> _Answer | None:
    """Return the answer of the push that explains the motion best, None where none is known.

    Where strokes that were not pushed explain the motion of one push better, a hand happened to move like the other one.
    """
    if any(answer.others >= 1.0 for answer in answers):
        return None
    return min((answer for answer in answers if answer.made), key=lambda answer: answer.others, default=None)


def judge(fits: Sequence[_Fit], record: Capability, axes: int) -> Tried:
    """Say what is wrong, and what is not known."""
    names = AXES[:axes]
    found = [_clearest([_Answer(fit, axis) for fit in fits]) for axis in range(axes)]
    known = [answer for answer in found if answer and answer.told]
    faults = [text for answer in known if (text := answer.fault(names))]
    blind = [name for name, answer in zip(names, found, strict=True) if answer not in known]
    unknown = [f"{', '.join(blind)}: held firmly, moved by something else, or without power"] if blind else []
    quiet = [answer for answer in known if answer.others <= QUIET]
    vague = [name for name in names if name not in blind and name not in {names[answer.axis] for answer in quiet}]
    if quiet:
        joint = np.mean([np.log(answer.costs.min(axis=1)) for answer in quiet], axis=0)
        late = np.flatnonzero(joint <= joint.min() + np.log(DOUBT))
        if late[0] >= TOLD_TICKS < late[-1]:
            span = f"{late[0]}" if len(late) == 1 else f"{late[0]} to {late[-1]}"
            faults.append(
                f"samples are {span} ticks later than they say: correct latency_ticks and age_ticks of its driver"
            )
        elif max(late[0] + 1, late[-1]) > TOLD_TICKS:  # 2 alone may be 0 to 3, by the hand
            unknown.append(f"age of samples, within {max(late[-1], TOLD_TICKS + 1)} ticks")
        for answer in quiet:
            name, sizes = names[answer.axis], answer.sizes(late)
            if sizes.min() > MOST_GAIN:
                cause = "its motor gain or position gain is too large, or its record's mass"
                faults.append(
                    f"{name}: it moves {np.median(sizes):.2g} times as far as its record's mass would: {cause}"
                )
            elif sizes.max() > MOST_GAIN:
                vague.append(name)
    elif len(blind) < axes:
        unknown.append("age of samples")
    if vague:
        unknown.append(f"gain along {', '.join(sorted(vague))}")
    return Tried(max((fit.pushed_n for fit in fits), default=0.0), tuple(faults), tuple(unknown), not blind)
