"""Packet loss concealments on one impaired network: the same hands, the same fate of every datagram; and a clean link.

Half of all datagrams are lost, in bursts; the rest jitters by 50 ms; every 3 s nothing at all comes through for 0.5 s. The
hands go to and fro by STROKE_S and rest for REST_S, which is no part of 3 s: outages strike at all phases of a stroke.

Drift is how far the gap from proxy to hand is from what it is at that moment on the clean link. It is taken once for each
recovery: at the last border before the next outage at which the hands have rested for QUIET_S. Part of it is the object
that still swings on its lines, with another phase than on the clean link. The position deficit of the lines is
T_n |D_up - D_down| / sqrt(2b), D [sqrt(W)] the waves sent and not played; the rest of the drift will swing out by itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import dist, hypot, sqrt
from typing import Any

from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.inputs import CloseLedger
from cogrip.protocol.line.concealment import CONCEALMENTS
from cogrip.protocol.settings.delays import Frames
from cogrip.protocol.settings.room import resolve
from cogrip.server.ports.wave_port import WavePort
from cogrip.sim.laboratory import Laboratory

CLEAN = "clean link"
ROWS = (CLEAN, *CONCEALMENTS)
STROKE_S, REST_S, QUIET_S = 0.8, 1.65, 1.0
OUTAGE_S, EVERY_S = 0.5, 3.0
HAND = f"reach&stroke_s={STROKE_S:g}&rest_s={REST_S:g}&hand_damping_nspm=10"
DIRECTIONS = ("1", "1,0.5", "1,0.5,0.25")
IMPAIRED: Mapping[str, Any] = {
    "delay_ms": 10.0, "jitter_ms": 50.0, "loss": 0.5, "burst_frames": 4.0, "outage_s": OUTAGE_S, "outage_every_s": EVERY_S,
}  # fmt: skip
Gaps = tuple[tuple[float, ...], ...]  # of all people, all axes [m], at each moment that counts


@dataclass(frozen=True, slots=True)
class Trial:
    """One concealment on the impaired network. Forces at the motor are felt; the law's are before safety limits their slew."""

    name: str
    peak_n: float
    step_n: float  # the largest change of the force from one tick to the next
    law_peak_n: float
    law_step_n: float
    least_margin_j: float
    least_leak_j: float
    missing: float  # share of the frames down that were not there in time
    longest_gap: int  # frames
    gaps_m: Gaps
    deficit_m: float  # the largest position deficit of a line, at the moments that count
    diverged: str
    lent_j: float = 0.0  # what a margin may be below 0: the credit of both directions


@dataclass(frozen=True, slots=True)
class Setup:
    """Settings that may differ between trials."""

    seconds: float = 600.0
    people: int = 2
    axes: int = 1
    kind: str = "cube"
    frames: Frames = 8
    seed: int = 1
    tank_mj: float = 80.0  # credit of the rows that fill gaps
    hand: str = HAND
    overrides: tuple[tuple[str, Any], ...] = ()  # of settings, by their paths; the link keeps its own


@dataclass(frozen=True, slots=True)
class Job:
    """One row, for whichever process takes it."""

    case: int
    setup: Setup
    name: str


def table(setup: Setup, name: str) -> dict[str, Any]:
    """The settings of a row."""
    clean = name == CLEAN
    hand = f"{setup.hand}&direction={DIRECTIONS[setup.axes - 1]}" if setup.hand == HAND else setup.hand
    return {
        "name": "storm",
        "seed": setup.seed,
        "seconds": setup.seconds,
        "object": {"kind": setup.kind, "axes": setup.axes, "damping_nspm": 2.0},
        "playout": {"frames": setup.frames} if clean else {
            "frames": setup.frames, "concealment": name, "tank_mj": setup.tank_mj if name in ("tank", "elastic") else 0.0,
        },
        "link": {"delay_ms": IMPAIRED["delay_ms"]} if clean else dict(IMPAIRED),
        "users": [
            {"name": f"user{number + 1}", "device": "sim:ideal", "hand": hand, "side": ("left", "right")[number % 2]}
            for number in range(setup.people)
        ],
    }  # fmt: skip


def moments(seconds: float, network_hz: int) -> list[int]:
    """Frames at which a recovery is judged."""
    out = []
    begin = EVERY_S + OUTAGE_S
    while begin + EVERY_S - OUTAGE_S <= seconds:
        last, first = int((begin + EVERY_S - OUTAGE_S) * network_hz) - 1, int(begin * network_hz)
        rested = [k for k in range(last, first, -1) if k / network_hz % (STROKE_S + REST_S) >= STROKE_S + QUIET_S]
        out += rested[:1]
        begin += EVERY_S
    return out


class Watch:
    """Forces tick by tick, and gaps at the moments that count."""

    def __init__(self, laboratory: Laboratory, at: Sequence[int]) -> None:
        self._at = set(at)
        self._last: list[tuple[float, ...]] = [(0.0,) * laboratory.settings.object.axes for _ in laboratory.people]
        self._wish = list(self._last)
        self.peak_n = self.step_n = self.law_peak_n = self.law_step_n = 0.0
        self.gaps_m: list[tuple[float, ...]] = []
        self.deficit_m = 0.0

    def tick(self, laboratory: Laboratory) -> None:
        for number, person in enumerate(laboratory.people):
            core = person.core
            force, wish = core.force_n, tuple(core.coupling.force(core.position_m, core.velocity_mps))
            self.peak_n = max(self.peak_n, hypot(*force))
            self.step_n = max(self.step_n, dist(force, self._last[number]))
            self.law_peak_n = max(self.law_peak_n, hypot(*wish))
            self.law_step_n = max(self.law_step_n, dist(wish, self._wish[number]))
            self._last[number], self._wish[number] = force, wish

    def frame(self, laboratory: Laboratory) -> None:
        if laboratory.room.steps in self._at:
            world = laboratory.room.world
            self.gaps_m.append(
                tuple(
                    hand - proxy
                    for number, person in enumerate(laboratory.people)
                    for hand, proxy in zip(person.core.position_m, world.proxy_of(number), strict=True)
                )
            )
            for seat, person in zip(laboratory.room.seats, laboratory.people, strict=True):
                port, coupling = seat.port, person.core.coupling
                if isinstance(port, WavePort) and isinstance(coupling, WaveCoupling):
                    scale_m = seat.settings.rates.frame_s / sqrt(2.0 * seat.settings.coupling.impedance_nspm)
                    deficit = (abs(up - down) for up, down in zip(port.deficit, coupling.deficit, strict=True))
                    self.deficit_m = max(self.deficit_m, scale_m * max(deficit))


def try_out(setup: Setup, name: str) -> Trial:
    """One row: a session in virtual time."""
    changes = {key: value for key, value in setup.overrides if name != CLEAN or key.split(".")[0] != "link"}
    settings = resolve(table(setup, name), changes)
    laboratory = Laboratory(settings)
    watch = Watch(laboratory, moments(setup.seconds, settings.rates.network_hz))
    laboratory.run(watch.tick, watch.frame)
    margins, sent, missing, longest = [], 0, 0, 0
    for number, person in enumerate(laboratory.people):
        seat = laboratory.room.seat_account(number)
        client = person.core.handle(CloseLedger(laboratory.ticks()), person.core.now_ns)
        assert client is not None
        margins += [seat.up_margin_j, seat.line_margin_j, client.down_margin_j]
        sent += client.down.sent
        missing += client.down.lost + client.down.late
        if client.playout is not None:
            longest = max(longest, client.playout.longest_gap)
    return Trial(
        name=name,
        peak_n=watch.peak_n,
        step_n=watch.step_n,
        law_peak_n=watch.law_peak_n,
        law_step_n=watch.law_step_n,
        lent_j=2e-3 * settings.playout.tank_mj,
        least_margin_j=min(margin for margin in margins if margin is not None),
        least_leak_j=min(person.core.ledger.least_leak_j for person in laboratory.people),
        missing=missing / max(1, sent),
        longest_gap=longest,
        gaps_m=tuple(watch.gaps_m),
        deficit_m=watch.deficit_m,
        diverged=laboratory.incident,
    )


def measure_row(job: Job) -> dict[str, Any]:
    """Run one row: its Trial is the measure `trial`."""
    return {"trial": try_out(job.setup, job.name)}


def drifts_mm(trial: Trial, clean: Trial) -> list[float]:
    """Return the drift of each recovery [mm], the largest over people and axes; of a session that diverged, those before."""
    return [
        1e3 * max(abs(one - other) for one, other in zip(row, there, strict=True))
        for row, there in zip(trial.gaps_m, clean.gaps_m, strict=not (trial.diverged or clean.diverged))
    ]
