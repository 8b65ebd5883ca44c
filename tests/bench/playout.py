"""`dev.py bench playout`: the playout that follows the jitter, beside the best fixed depth with hindsight. Virtual time."""

from typing import Annotated, Any, get_args

from cyclopts import Parameter
from rich.console import Group

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.line.receiver import LATE
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.link_profile import Link
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.rates import Hz, Rates
from cogrip.protocol.settings.sections import Playout
from cogrip.results.reading.folder import finite

from tests.bench.playout_trial import (
    TICKS,
    NothingCameError,
    Played,
    arrivals,
    beaten,
    best_fixed,
    fixed_delays,
    play,
    ratio,
)

BOUND = 1.2  # of the best fixed depth's delay, and of the frames that it loses to lateness
DIRECTIONS = ("up", "down")
MOST_SEEDS = 10_000
LEAST_S, MOST_S = 1.0, 3600.0
LEAST_HZ, MOST_HZ = get_args(Hz)[1].ge, get_args(Hz)[1].le


def bench_playout(
    *,
    seeds: int = 20,
    seconds: float = 60.0,
    network_hz: int = 128,
    profile: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    json: Json = None,
) -> int:
    """Play the same datagrams out with frames = "auto" and at every fixed depth, on each profile, in both directions.

    The best fixed depth is chosen with hindsight over all seeds: of one delay in ticks through all runs, the shortest with no
    more late frames than `playout.late` allows. held is the delay beyond the quickest datagram; late are the frames that came
    and were not played in time, what was passed over among them. "frames" is the least of the numbers that [playout] takes that
    keeps the same rate: it counts from the first datagram, whose jitter is luck. beaten: whether any fixed delay is better by
    1.2 times in both.

    Parameters
    ----------
    seeds
        Runs of each profile and direction.
    seconds
        Virtual time of each run.
    network_hz
        Frames a second.
    profile
        Only this profile. Repeatable.
    """
    if not 1 <= seeds <= MOST_SEEDS:
        raise BadInput(f"--seeds {seeds}: from 1 to {MOST_SEEDS}")
    if not LEAST_S <= seconds <= MOST_S:
        raise BadInput(f"--seconds {seconds:g}: from {LEAST_S:g} to {MOST_S:g} s")
    if not LEAST_HZ <= network_hz <= MOST_HZ:
        raise BadInput(f"--network-hz {network_hz}: from {LEAST_HZ} to {MOST_HZ} frames a second")
    for name in profile:
        if name not in PROFILES:
            raise BadInput(f"--profile {name}: is none of {', '.join(PROFILES)}")
    console = make_console(stderr=json == "-")
    rows = []
    for name in PROFILES:
        if not profile or name in profile:
            for direction in DIRECTIONS:
                console.print(f"{name} {direction}: {seeds} runs of {seconds:g} s", style="dim")
                try:
                    rows.append(_trial(name, direction, seeds, seconds, network_hz))
                except NothingCameError as error:
                    raise BadInput(
                        f"--seconds {seconds:g} at --network-hz {network_hz}: {name} {direction}: {error}; give more"
                    ) from None
    console.print(_table(rows, network_hz))
    kept = all(row["delay_ratio"] <= BOUND and row["late_ratio"] <= BOUND and not row["beaten"] for row in rows)
    console.print(f"at most {BOUND:g} times delay and late frames are asked for: {'kept' if kept else 'NOT kept'}")
    if json:
        write_json(finite({"rows": rows}), json)
    return 0 if kept else 1


def _trial(name: str, direction: Any, seeds: int, seconds: float, network_hz: int) -> dict[str, Any]:
    link = Link(profile=name).direction(direction)  # type: ignore[arg-type]
    runs = [arrivals(link, f"{seed}/{direction}", seconds, network_hz) for seed in range(1, seeds + 1)]
    ours = [play(run, "auto") for run in runs]
    delays = fixed_delays(runs)
    quickest = delays[0].delay_ticks
    best = best_fixed(delays)
    depth = -(-(best.delay_ticks - quickest) // TICKS)
    numbers = {frames: [play(run, frames) for run in runs] for frames in range(max(0, depth - 2), depth + 3)}
    chosen = next((frames for frames in numbers if _late(numbers[frames]) <= LATE), depth + 2)
    delay, late = _delay(ours), _late(ours)
    tick_ms = 1e3 / network_hz / TICKS
    link_ticks = link.delay_ms / tick_ms
    expected = line_delay(Playout(frames="auto"), link, Rates(network_hz * TICKS, network_hz)).ticks
    return {
        "profile": name,
        "direction": direction,
        "delay_ms": delay * tick_ms,
        "held_ms": (delay - quickest) * tick_ms,
        "late_share": late,
        "moves_a_minute": sum(one.account.repeated + one.account.skipped for one in ours) / seeds / seconds * 60.0,
        "most_frames": max(one.account.most_frames for one in ours),
        "best_held_ms": (best.delay_ticks - quickest) * tick_ms,
        "best_late_share": best.late / best.sent,
        "best_delay_ms": best.delay_ticks * tick_ms,
        "delay_ratio": max(ratio(delay, best.delay_ticks), ratio(delay - link_ticks, best.delay_ticks - link_ticks)),
        "late_ratio": late / LATE,
        "beaten": beaten(delays, delay, late, BOUND),
        "expected_ms": expected * tick_ms,
        "number": chosen,
        "number_delay_ms": _delay(numbers[chosen]) * tick_ms,
        "number_late_share": _late(numbers[chosen]),
    }


def _delay(runs: list[Played]) -> float:
    return sum(run.delay_ticks for run in runs) / len(runs)


def _late(runs: list[Played]) -> float:
    sent = sum(run.sent for run in runs)
    if not sent:
        raise NothingCameError("nothing was played out before the end")
    return sum(run.late for run in runs) / sent


def _table(rows: list[dict[str, Any]], network_hz: int) -> Group:
    """Two tables of at most 80 columns: beside the best depth with hindsight, and the best of the numbers one may set."""
    headings = (
        "\ndirection", "auto\nms", "\nheld", "late\n%", "moves\n/ min", "best\nms", "\nheld", "late\n%", "delay\nx", "late\nx",
        "\nbeaten",
    )  # fmt: skip
    beside, numbers = [], []
    for row in rows:
        direction = f"{row['profile']} {row['direction']}"
        beside.append([
            direction, f"{row['delay_ms']:.2f}", f"{row['held_ms']:.2f}", f"{100 * row['late_share']:.3f}",
            f"{row['moves_a_minute']:.1f}", f"{row['best_delay_ms']:.2f}", f"{row['best_held_ms']:.2f}",
            f"{100 * row['best_late_share']:.3f}", f"{row['delay_ratio']:.3f}", f"{row['late_ratio']:.3f}",
            "yes" if row["beaten"] else "no",
        ])  # fmt: skip
        share = f"{100 * row['number_late_share']:.3f}"
        numbers.append(
            [direction, str(row["number"]), f"{row['number_delay_ms']:.2f}", share, f"{row['expected_ms']:.2f}"]
        )
    title = f"auto beside the best fixed depth, {network_hz} frames a second"
    second = ("direction", "frames", "ms", "late %", "expected of auto")
    return Group(
        plain_table(headings, beside, title=title), "",
        plain_table(second, numbers, title="the best number for playout.frames"),
    )  # fmt: skip
