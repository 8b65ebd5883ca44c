"""`dev.py bench guard`: could a guard within a session find a wrong sign, swapped axes or a gain of 2 early, and no hand?

Sessions in virtual time of emulated arms in simulated and recorded hands, with each fault and with none. Three statistics of
samples and forces, each with the bound above all of its values in sessions of arms that are well: at which force is a fault
found then?

symbols: v mean velocity of a frame [m/s], F force that loads the hand [N], m apparent mass by the record [kg], a = -(1/m) of
the force's impulse between the middles of two frames [m/s]

    gain   g of v_{k+1} - v_k = g a_k + history, over 0.5 s, in standard errors: below 0, of the other axis, or above 1.5
    power  work of a hand that the record makes of the motion, sum of F dx + m v^2 / 2, in 50 ms [J]
    speed  of the motion, no force considered [m/s]
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import cogrip.api as cogrip
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import plain_table
from cogrip.sim.laboratory import Laboratory

from tests.devices.faulty_device import FAULTS, SWAP, FaultyDevice
from tests.devices.test_motor_trial import DATA, pieces

Array = NDArray[np.float64]

ARMS = ("emulated:vintage", "emulated:woodenhaptics")
OBJECTS = ("cube", "wall")
HANDS = (
    "hold&hand_stiffness_npm=60&hand_damping_nspm=1", "hold", "reach&amplitude_m=0.03", "reach&stroke_s=0.4&amplitude_m=0.05",
    "tremor&tremor_m=0.0005", "sine&amplitude_m=0.02&frequency_hz=2",
    "sine&amplitude_m=0.01&frequency_hz=5&hand_stiffness_npm=800&hand_damping_nspm=10",
)  # fmt: skip
PARTNER = "sine&amplitude_m=0.02&frequency_hz=0.7&hand_stiffness_npm=200"
FRAME, RATE_HZ, AXES = 8, 1024, 3
WINDOW, PAST, EVERY = 64, 4, 8  # frames
EARLY = 0.2  # share of the peak force below which a fault is to be found


class Watched(NamedTuple):
    """A session: samples [m] and forces [N] of live ticks, shape (n, 3); peak force and apparent mass of the record."""

    position_m: Array
    force_n: Array
    peak_n: float
    mass_kg: float


def watched(arm: str, hand: str, fault: str, kind: str, seconds: float) -> Watched:
    """Run a session. Raises ValueError for one that ends at once, where the hand is outside of the workspace."""
    users = {0: {"device": arm, "hand": hand}, 1: {"device": "sim:phantom", "hand": PARTNER}}
    settings = cogrip.settings(
        "demo", seconds=seconds, users=users, link={"delay_ms": 10.0}, object={"axes": AXES, "kind": kind},
        coupling={"impedance_nspm": 3.0},
    )  # fmt: skip
    laboratory = Laboratory(settings)
    person = laboratory.people[0]
    person.device = FaultyDevice(person.device, fault)
    rows: list[tuple[Sequence[float], Sequence[float]]] = []

    def tick(_: Laboratory) -> None:
        seat = person.core.seated
        if seat is not None and seat.safety.state == "live" and seat.hand.position_m is not None:
            rows.append((tuple(seat.hand.position_m), tuple(seat.force_n)))

    laboratory.run(tick, None, lambda: person.core.in_fault)
    record = person.device.capability
    position, force = np.array([row[0] for row in rows]), np.array([row[1] for row in rows])
    return Watched(position, force, record.peak_force_n, record.apparent_mass_kg)


def cases(folder: Path, recorded: int) -> Iterator[tuple[str, str, str, str, float]]:
    """Yield (arm, hand, fault, object, seconds)."""
    hands = list(pieces(folder, 0, recorded))
    for arm in ARMS:
        for kind in OBJECTS:
            for fault in ("", *FAULTS):
                yield from ((arm, hand, fault, kind, 3.0) for hand in HANDS)
                yield from ((arm, hand, fault, kind, 1.5) for hand in (hands if not fault else hands[: len(HANDS)]))


def frames_of(session: Watched) -> tuple[Array, Array, Array]:
    """Return v_{k+1} - v_k, a_k and v_k of each frame, shape (frames, 3)."""
    count = len(session.position_m) // FRAME
    ends = session.position_m[: count * FRAME : FRAME]
    v = np.diff(ends, axis=0) * RATE_HZ / FRAME
    force = session.force_n[: count * FRAME].reshape(count, FRAME, AXES)
    rising = ((np.arange(FRAME) + 0.5) / FRAME)[None, :, None]
    impulse = ((force[:-1] * rising).sum(axis=1) + (force[1:] * (1.0 - rising)).sum(axis=1)) / RATE_HZ
    change = np.diff(v, axis=0)
    size = min(len(change), len(impulse))
    return change[:size], -impulse[:size] / session.mass_kg, v[:size]


def gains(session: Watched) -> Iterator[tuple[int, Array, Array]]:
    """Yield (tick, gains, standard errors) now and then, each of shape (moved axis, pushed axis)."""
    change, a, v = frames_of(session)
    history = [np.ones((len(v), 1)), *[np.roll(v, late, axis=0) for late in range(PAST)]]
    history += [np.roll(a, late, axis=0) for late in range(1, PAST)]
    known = np.concatenate(history, axis=1)
    for end in range(WINDOW + PAST, len(change), EVERY):
        span = slice(end - WINDOW, end)
        basis, _ = np.linalg.qr(known[span])
        y, u = (each[span] - basis @ (basis.T @ each[span]) for each in (change, a))
        square = u.T @ u + 1e-12 * np.eye(AXES)
        found: Array = np.asarray(np.linalg.solve(square, u.T @ y).T, dtype=np.float64)
        rest = ((y - u @ found.T) ** 2).sum(axis=0) / (WINDOW - known.shape[1] - AXES)
        yield (
            end * FRAME,
            found,
            np.asarray(np.sqrt(np.outer(rest, np.diag(np.linalg.inv(square))) + 1e-12), dtype=np.float64),
        )


def by_gain(session: Watched, fault: str) -> Iterator[tuple[int, float]]:
    """Yield (tick, how sure it is, in standard errors) that the motion has this fault."""
    own = np.eye(AXES, dtype=bool)
    for tick, found, error in gains(session):
        if "gain" in fault:
            yield tick, float(((found - 1.5) / error)[own].max())
        elif fault == SWAP:
            yield tick, float(((np.abs(found) - 0.5) / error)[~own].max())
        else:
            yield tick, float((-found / error)[own].max())


def by_power(session: Watched, fault: str) -> Iterator[tuple[int, float]]:
    """Yield (tick, work of the hand in the 50 ms before)."""
    change, _, v = frames_of(session)
    moved = v * FRAME / RATE_HZ
    force = session.force_n[: len(v) * FRAME].reshape(len(v), FRAME, AXES).mean(axis=1)
    work = (force * moved).sum(axis=1) + 0.5 * session.mass_kg * ((v + change) ** 2 - v**2).sum(axis=1)
    total, span = np.cumsum(work), 6
    yield from ((frame * FRAME, float(total[frame] - total[frame - span])) for frame in range(span, len(work)))


def by_speed(session: Watched, fault: str) -> Iterator[tuple[int, float]]:
    """Yield (tick, speed)."""
    _, _, v = frames_of(session)
    yield from ((frame * FRAME, float(speed)) for frame, speed in enumerate(np.linalg.norm(v, axis=1)))


STATISTICS: Mapping[str, Any] = {"gain": by_gain, "power": by_power, "speed": by_speed}


def found_at(session: Watched, values: Iterator[tuple[int, float]], bound: float) -> float | None:
    """Return the largest force so far, as a share of the peak, where a value is first above the bound; None for never."""
    tick = next((tick for tick, value in values if value > bound), None)
    if tick is None:
        return None
    return float(np.linalg.norm(session.force_n[: tick + 1], axis=1).max()) / session.peak_n


def bench_guard(*, recorded: int = 30) -> int:
    """Compare three statistics of a guard within a session, each with the bound that no arm that is well passes.

    Parameters
    ----------
    recorded
        Pieces of recorded hands, of ../shared/data.
    """
    if recorded and not DATA.is_dir():
        raise Problem(f"{DATA} is not there, and holds the recorded hands; put it there, or give --recorded 0")
    sessions: dict[str, list[Watched]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for arm, hand, fault, kind, seconds in cases(Path(folder), recorded):
            try:
                session = watched(arm, hand, fault, kind, seconds)
            except (ValueError, cogrip.DeviceError):
                continue
            if len(session.position_m) > 2 * FRAME:
                sessions.setdefault(fault, []).append(session)
    well = sessions.pop("")
    rows: list[tuple[str, ...]] = []
    for name, statistic in STATISTICS.items():
        for fault, faulty in sessions.items():
            worst = sorted(max((value for _, value in statistic(each, fault)), default=0.0) for each in well)
            for place in (len(worst) - 1, len(worst) * 95 // 100):
                bound, alarms = worst[place], len(worst) - 1 - place
                found = [
                    share for each in faulty if (share := found_at(each, statistic(each, fault), bound)) is not None
                ]
                early = np.count_nonzero(np.array(found) < EARLY)
                median = f"{100.0 * float(np.median(found)):.0f} %" if found else "-"
                row = f"{bound:.2g}", str(alarms), f"{len(found)} of {len(faulty)}", str(early), median
                rows.append((name, fault, *row))
    headings = ("by", "fault", "bound", "alarms", "found", "early", "median at")
    make_console(soft_wrap=True).print(plain_table(headings, rows, left=2))
    make_console(soft_wrap=True).print(
        f"alarms: of {len(well)} sessions of arms that are well; early: below {EARLY:.0%} of the peak force"
    )
    return 0
