"""`dev.py bench velocity`: velocity estimators on recorded hands, as each device's encoders see them, and in whole sessions."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput
from cogrip.client.hand.velocity import MotionObserver, impedance_bounds, largest_impedance, memory_for
from cogrip.devices.device import Capability

from tests.bench.velocity_trial.comparison import Found, chosen, compare, devices
from tests.bench.velocity_trial.estimators import AdaptiveWindow, FollowingAlphaBeta
from tests.bench.velocity_trial.hands import Motion, NoHandsError, recorded_hands
from tests.bench.velocity_trial.session import largest_quiet

RATE_HZ = 1024
_UPDATES = 20_000


def bench_velocity(
    *,
    data: Path = Path("../shared/data"),
    device: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    json: Json = None,
) -> int:
    """Compare estimators of velocity on each device, and say what impedance each device carries. Takes some minutes.

    Alpha-beta with each memory, an adaptive window of as many samples, alpha-beta whose memory follows the speed, and what the
    client runs with. Error, delay and noise are those on the recorded hands; slow is the noise below 10 mm/s; newtons are at
    b = 20 N s/m. b is the largest with which a session of two such devices, loosely held, comes to rest. * has the least noise
    of those whose b is at least 25 N s/m, or 90 % of the largest where none reaches that.

    Parameters
    ----------
    data
        Folder of the recorded hands.
    device
        Only this device, such as sim:phantom. Repeatable.
    """
    every = devices()
    for name in device:
        if name not in every:
            raise BadInput(f"--device {name}: is none of {', '.join(every)}")
    try:
        motions = recorded_hands(data, RATE_HZ)
    except NoHandsError as error:
        raise BadInput(f"--data {data}: {error}") from None
    console = make_console(stderr=json == "-")
    answer: dict[str, Any] = {"devices": {}}
    for name, record in every.items():
        if not device or name in device:
            found = compare(record, motions, 1.0 / RATE_HZ, largest_quiet)
            console.print(_table(name, record, found))
            answer["devices"][name] = _record(record, found)
    spent = answer["update_us"] = _spent(motions)
    console.print("one update of three axes: " + ", ".join(f"{name} {us:.1f} us" for name, us in spent.items()))
    if json:
        write_json(answer, json)
    return 0


def _table(name: str, record: Capability, found: Sequence[Found]) -> Table:
    tick_s = 1.0 / RATE_HZ
    carried = largest_impedance(record, tick_s)
    bounds = ", ".join(f"{bound} {value:.3g}" for bound, value in impedance_bounds(record, tick_s).items())
    table = Table(
        title=f"{name}: {1e3 * record.apparent_mass_kg:g} g, {1e3 * record.resolution_m:.3g} mm, "
        f"{record.latency_ticks} ticks old; memory {memory_for(record, tick_s):.3f}",
        caption=f"bounds of b: {bounds}; carries {carried.impedance_nspm:.3g} N s/m",
    )
    table.add_column("estimator", no_wrap=True)
    for column in ("error mm/s", "delay ms", "slow mm/s", "noise mm/s", "force N", "peak N", "b N s/m"):
        table.add_column(column, justify="right")
    best = chosen(found)
    for one in found:
        table.add_row(
            f"{one.estimator} *" if one is best else one.estimator,
            f"{1e3 * one.error_mps:.2f}", f"{1e3 * one.delay_s:.2f}", f"{1e3 * one.slow_mps:.2f}",
            f"{1e3 * one.noise_mps:.2f}", f"{one.force_n(one.noise_mps):.3f}", f"{one.force_n(one.peak_mps):.3f}",
            f"{one.largest_nspm:.3g}",
        )  # fmt: skip
    return table


def _record(record: Capability, found: Sequence[Found]) -> dict[str, Any]:
    tick_s = 1.0 / RATE_HZ
    carried = largest_impedance(record, tick_s)
    bounds = impedance_bounds(record, tick_s)
    return {
        "apparent_mass_kg": record.apparent_mass_kg,
        "resolution_m": record.resolution_m,
        "latency_ticks": record.latency_ticks,
        "memory": memory_for(record, tick_s),
        "bounds_nspm": {bound: value if np.isfinite(value) else None for bound, value in bounds.items()},
        "largest_impedance_nspm": carried.impedance_nspm,
        "impedance_bound": carried.bound,
        "chosen": chosen(found).estimator,
        "estimators": {
            one.estimator: {
                "error_mps": one.error_mps, "delay_s": one.delay_s, "slow_noise_mps": one.slow_mps,
                "noise_mps": one.noise_mps, "force_noise_n": one.force_n(one.noise_mps),
                "force_peak_n": one.force_n(one.peak_mps), "largest_quiet_nspm": one.largest_nspm,
            }
            for one in found
        },
    }  # fmt: skip


def _spent(motions: Sequence[Motion]) -> dict[str, float]:
    """Microseconds of one update of three axes: medians of five rounds, taken in turn."""
    tick_s, count_m = 1.0 / RATE_HZ, 3e-5
    longest = max(motions, key=lambda motion: len(motion.position_m)).position_m
    place = np.resize(np.round(longest / count_m) * count_m, _UPDATES)
    samples = [(x, -x, 0.5 * x) for x in place.tolist()]
    makers: dict[str, Callable[[], MotionObserver | AdaptiveWindow | FollowingAlphaBeta]] = {
        "alpha-beta": lambda: MotionObserver(3, tick_s),
        "following": lambda: FollowingAlphaBeta(3, tick_s, count_m),
        "window 8": lambda: AdaptiveWindow(3, tick_s, count_m, 8),
        "window 16": lambda: AdaptiveWindow(3, tick_s, count_m, 16),
    }
    rounds: dict[str, list[float]] = {name: [] for name in makers}
    for _ in range(5):
        for name, make in makers.items():
            update = make().update
            start = time.perf_counter()
            for sample in samples:
                update(sample)
            rounds[name].append(1e6 * (time.perf_counter() - start) / len(samples))
    return {name: float(np.median(times)) for name, times in rounds.items()}
