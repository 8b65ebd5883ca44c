"""`dev.py bench client`: what a live client's tick takes, and how many of its ticks run."""

import os
import signal
import statistics
import tempfile
from pathlib import Path

import msgspec

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Datagram, kind_of
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import Waves, decode
from cogrip.results.reading.folder import SERVER_RECORDING, SETTINGS, client_recording, read_accounts, write_settings

from tests.bench import machine
from tests.bench.children import output_at_end, start_cogrip, wait_for_line
from tests.bench.targets import reached

MOST_WORK_US = {1024: 25.0, 8192: 20.0}
LEAST_RUN = 0.99
MOST_ROUND_TRIP_US = 150.0  # at the lower rate, and less the wait for the other end's step or tick: see `_trip_us`
NO_LINK = {"link.delay_ms": 0.0, "link.jitter_ms": 0.0, "link.loss": 0.0}  # else it is in the round trip
_END_LIMIT_S = 30.0
_LINK = r"(cogrip://[^' ]+)'"


def bench_client(*, seconds: float = 10.0, rounds: int = 3, people: int = 2) -> int:
    """Live sessions over loopback, encrypted and recorded, 3 axes: at 1024 Hz and at 8192 Hz, in turns.

    Exit code 0 if everything that is asked for is reached.

    Parameters
    ----------
    seconds
        How long each session is.
    rounds
        Sessions at each rate; medians count.
    people
        How many take part, 1 to 3.
    """
    if seconds < 2.0 or rounds < 1 or not 1 <= people <= 3:
        raise BadInput("bench client needs sessions of at least 2 s, at least 1 round, and 1 to 3 people")
    console = make_console(soft_wrap=True)
    accounts: dict[int, list[ClientAccount]] = {rate_hz: [] for rate_hz in MOST_WORK_US}
    trips: dict[int, list[tuple[float, float]]] = {rate_hz: [] for rate_hz in MOST_WORK_US}
    broken: list[str] = []
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        for number in range(rounds):
            for rate_hz, found in accounts.items():
                folder = Path(base) / f"{rate_hz}-{number}"
                ended, reasons = _session(folder, rate_hz, people, seconds)
                found += ended
                trips[rate_hz].append(_trip_us(folder))
                broken += [f"{rate_hz} Hz: {reason}" for reason in reasons]
    rows, well = [], True
    for rate_hz, found in accounts.items():
        if not any(each.ticks.due for each in found):
            raise Problem(f"no session at {rate_hz} Hz left an account:\n" + "\n".join(broken))
        work_us = statistics.median([each.ticks.work_us.p50 for each in found if each.ticks.work_us.p50 is not None])
        tail_us = statistics.median([each.ticks.work_us.p99 for each in found if each.ticks.work_us.p99 is not None])
        run = statistics.median([each.ticks.run / each.ticks.due for each in found if each.ticks.due])
        asked = (work_us <= MOST_WORK_US[rate_hz], run >= LEAST_RUN)
        well = well and all(asked)
        rows += [
            (f"{rate_hz} Hz: a tick, p50", f"{work_us:.0f} µs", f"at most {MOST_WORK_US[rate_hz]:g}", reached(asked[0])),
            ("  p99", f"{tail_us:.0f} µs", "", ""),
            ("  ticks that ran", f"{100 * run:.1f} %", f"at least {100 * LEAST_RUN:g}", reached(asked[1])),
        ]  # fmt: skip
        there_us, back_us = [statistics.median(parts) for parts in zip(*trips[rate_hz], strict=True)]
        trip_us, asked_us = there_us + back_us, ("", "")
        if rate_hz == min(trips):
            well = well and trip_us <= MOST_ROUND_TRIP_US
            asked_us = f"at most {MOST_ROUND_TRIP_US:g}", reached(trip_us <= MOST_ROUND_TRIP_US)
        rows += [
            ("  round trip, p50", f"{trip_us:.0f} µs", *asked_us),
            ("  there, back", f"{there_us:.0f}, {back_us:.0f} µs", "", ""),
        ]
    console.print(plain_table((f"{people} people", "measured", "asked", ""), rows))
    for reason in broken:
        console.print(f"broke off, {reason}", markup=False)
    console.print(f"load of this machine: {machine.load():.1f}; {os.cpu_count()} processors")
    return 0 if well and not broken else 1


def _session(folder: Path, rate_hz: int, people: int, seconds: float) -> tuple[list[ClientAccount], list[str]]:
    """Run an encrypted server and its clients as processes; return the clients' accounts, and why each of them broke off."""
    settings = load(shipped("three-users"), {"rates.device_hz": rate_hz, **NO_LINK})
    write_settings(folder, settings)
    names = [user.name for user in settings.users[:people]]
    common = ["--into", str(folder)]
    serve = ["serve", str(folder / SETTINGS), "--port", "0", "--encrypted", "--state", str(folder / "state"), *common]
    with start_cogrip(*serve, "--seconds", str(seconds + 60.0)) as server:
        link = wait_for_line(server, _LINK)[1]
        join = ["join", link, "--seconds", str(seconds), *common]
        clients = [start_cogrip(*join, "--name", name) for name in names]
        try:
            ended = [output_at_end(client, seconds + _END_LIMIT_S) for client in clients]
        finally:
            server.send_signal(signal.SIGTERM)
        ended.append(output_at_end(server, _END_LIMIT_S))
    reasons = [printed.strip().rpartition("\n")[2] for printed, well in ended if not well]
    return [account for account in read_accounts(folder, names).values() if account is not None], reasons


def _trip_us(folder: Path) -> tuple[float, float]:
    """Return how long a session's waves are under way, there and back, p50 [us].

    From the beginning of the tick, or step, that makes them, by their stamp, to their arrival at the other end, by its kernel:
    the wait for the other end's step or tick, which is anything up to a period, is not in it. All processes have one clock.
    """
    there = _waited_us(folder / SERVER_RECORDING)
    back = [each for path in folder.glob(client_recording("*")) for each in _waited_us(path)]
    return statistics.median(there), statistics.median(back)


def _waited_us(path: Path) -> list[float]:
    """Return the time from the stamp of each frame in a recording to when it came [us]."""
    recording, found = open_recording(path), []
    read = msgspec.json.Decoder(Datagram).decode
    for message in recording.messages():
        if kind_of(recording.topics[message.topic]) == "datagram_in":
            came = decode(read(message.payload).data)
            if isinstance(came, Waves):
                found.append((message.time_ns - came.stamp.sent_ns) * 1e-3)
    return found
