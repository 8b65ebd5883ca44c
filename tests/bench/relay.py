"""`dev.py bench relay`: what a relay adds by itself, beside direct datagrams in the same run."""

import json as jsons
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.machine.pacing import Pacer
from cogrip.protocol.settings.network_profiles import PROFILES, ProfileName
from cogrip.protocol.settings.room import resolve
from cogrip.sim.link import fates

from tests.bench import machine
from tests.bench.children import start_cogrip, start_python, wait_for_line
from tests.bench.loads.echo import HOST, NETWORK_HZ, STAMP, receive, stamped
from tests.bench.processors import two_processors
from tests.bench.targets import reached

MOST_ADDED_US = 200.0  # p99
BYTES = 300  # a datagram of waves on three axes with R = 8 has about as many
SETTLE_S = 0.5
SEED = 1
LINGER_S = 0.2
WIDTH = 100
END_LIMIT_S = 10.0
PERCENTILES = {"p50": 50.0, "p99": 99.0, "max": 100.0}


@dataclass(slots=True)
class User:
    """Two sockets, one straight to the echo and one to the relay, and what each datagram took, by number [ns]."""

    direct: socket.socket
    relayed: socket.socket
    up: dict[str, dict[int, int]] = field(default_factory=lambda: {"direct": {}, "relayed": {}})
    down: dict[str, dict[int, int]] = field(default_factory=lambda: {"direct": {}, "relayed": {}})
    sent: int = 0

    def say(self) -> None:
        """Send one datagram directly and one through the relay; they take turns to be first."""
        order = (self.direct, self.relayed) if self.sent % 2 else (self.relayed, self.direct)
        for each in order:
            each.send(STAMP.pack(self.sent, time.time_ns(), 0, 0) + bytes(BYTES - STAMP.size))
        self.sent += 1

    def hear(self) -> None:
        for name, each in (("direct", self.direct), ("relayed", self.relayed)):
            with suppress(BlockingIOError):
                while True:
                    datagram, here_ns, _ = receive(each)
                    number, sent_ns, had_ns, answered_ns = STAMP.unpack_from(datagram)
                    self.up[name].setdefault(number, had_ns - sent_ns)  # of two copies, the first
                    self.down[name].setdefault(number, here_ns - answered_ns)


def bench_relay(*, users: int = 5, seconds: float = 5.0, profile: ProfileName | None = None, json: Json = None) -> int:
    """Datagrams of 300 bytes, 128 a second and user, there and back: straight, and through `cogrip relay` without impairment.

    Every user sends when it likes; the far end answers all in one burst, as a server does. Times are the kernel's: from the
    call that sends to the moment at which the receiver's kernel has it, so that only the relay's own waking, work and
    sending count. The relay stays on one processor, users and far end on another. Exit code 0 if it adds less than 0.2 ms
    (p99) in each direction.

    Parameters
    ----------
    users
        How many.
    seconds
        How long.
    profile
        Emulate this network up to the far end; `added` is then what the uplink took beyond the delay that was drawn for
        it, datagram by datagram.
    """
    within("--users", users, 1, 64)
    within("--seconds", seconds, 1, 600)
    if not sys.platform.startswith("linux"):
        raise Problem("bench relay reads the kernel's own times of receipt, which only Linux gives")
    console = make_console(stderr=json == "-")
    console.width = max(console.width, WIDTH)
    before = machine.load()
    with ExitStack() as stack:
        _, core = stack.enter_context(two_processors(console))
        echo = stack.enter_context(echo_server())
        port, ended = stack.enter_context(relay_to(echo, core, profile))
        people = [User(stack.enter_context(_dial(echo)), stack.enter_context(_dial(port))) for _ in range(users)]
        _run(people, SETTLE_S)
        first = people[0].sent
        _run(people, seconds)
        report = ended()
    after = machine.load()
    answer = {
        "users": users, "seconds": seconds, "bytes": BYTES, "load_before": before, "load_after": after,
        "profile": profile,
        **{direction: _compared([getattr(user, direction) for user in people], first) for direction in ("up", "down")},
        "relay_left_late_us": report["late_us"], "relay_trouble": report["trouble"],
    }  # fmt: skip
    if profile is not None:
        answer["up"]["added_us"] = _beyond_drawn(people, profile, first)
    well = all(answer[direction]["added_us"]["p99"] < MOST_ADDED_US for direction in ("up", "down"))
    what = f"through {profile} on the uplink" if profile else "without impairment"
    console.print(
        f"{users} users, {NETWORK_HZ} Hz, {BYTES} bytes, {seconds:g} s, {what}; us from sending to the kernel"
    )
    console.print(_table(answer))
    console.print(f"load {before:.1f} before, {after:.1f} after; other work makes every number larger")
    console.print(f"less than {MOST_ADDED_US / 1e3:g} ms (p99) is asked for: {reached(well)}")
    if json is not None:
        write_json({**answer, "reached": well}, json)
    return 0 if well else 1


@contextmanager
def echo_server() -> Iterator[int]:
    """Its port."""
    child = start_python("-m", "tests.bench.loads.echo")
    try:
        assert child.stdout is not None
        yield int(child.stdout.readline())
    finally:
        assert child.stdin is not None
        child.stdin.close()
        _wait(child)


@contextmanager
def relay_to(port: int, core: int | None, profile: ProfileName | None) -> Iterator[tuple[int, Any]]:
    """A `cogrip relay` to that port, on that processor: its own port, and what ends it and gives its summary."""
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        summary_at = Path(base) / "relay.json"
        child = start_cogrip(
            "relay", "--to", f"{HOST}:{port}", "--listen", f"{HOST}:0", "--json", str(summary_at), "--seed", str(SEED),
            *(f"--set=link.up.{key}={value}" for key, value in _uplink(profile).items()), stderr=None,
        )  # fmt: skip
        try:
            if core is not None:
                machine.pin(child.pid, {core})
            found = wait_for_line(child, r"relaying from \S+:(\d+) ")

            def end() -> dict[str, Any]:
                child.send_signal(signal.SIGINT)
                _wait(child)
                summary: dict[str, Any] = jsons.loads(summary_at.read_text())
                return summary

            yield int(found[1]), end
        finally:
            if child.poll() is None:
                child.send_signal(signal.SIGTERM)
            _wait(child)


def _wait(child: subprocess.Popen[Any]) -> None:
    try:
        child.wait(END_LIMIT_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _dial(port: int) -> socket.socket:
    own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stamped(own)
    own.connect((HOST, port))
    return own


def _run(people: Sequence[User], seconds: float) -> None:
    """Everybody speaks 128 times a second, one after the other."""
    pacer = Pacer(NETWORK_HZ * len(people), time.monotonic_ns() + 2_000_000)
    while pacer.due < seconds * NETWORK_HZ * len(people):
        user = people[pacer.wait() % len(people)]
        user.say()
        user.hear()
        pacer.done()
    end_ns = time.monotonic_ns() + round(LINGER_S * 1e9)
    while time.monotonic_ns() < end_ns:  # datagrams under way
        for user in people:
            user.hear()
        time.sleep(0.001)


def _uplink(profile: ProfileName | None) -> dict[str, float]:
    """Return the emulated link: uplink only, and no outage, so that as many as possible come to be timed."""
    values = PROFILES[profile].direction("up") if profile else {}
    return {key: value for key, value in values.items() if not key.startswith("outage")}


def _beyond_drawn(people: Sequence[User], profile: ProfileName, first: int) -> dict[str, float]:
    """Percentiles [us] of what the relayed datagrams took on the uplink beyond what the link drew for their numbers."""
    link = resolve({"link": _uplink(profile)}).link.direction("up")
    beyond = []
    for number, user in enumerate(people):
        drawn = islice(fates(link, f"{SEED}/{number}/up"), user.sent)
        for datagram, fate in enumerate(drawn):
            took_ns = user.up["relayed"].get(datagram)
            if took_ns is None or datagram < first:
                continue
            waits_ns = fate.extra_ns if fate.copy_extra_ns is None else min(fate.extra_ns, fate.copy_extra_ns)
            beyond.append((took_ns - link.delay_ms * 1e6 - waits_ns) * 1e-3)
    return _percentiles(np.array(beyond))


def _percentiles(values: Any) -> dict[str, float]:
    return {name: float(np.percentile(values, share)) for name, share in PERCENTILES.items()}


def _compared(found: Sequence[dict[str, dict[int, int]]], first: int) -> dict[str, Any]:
    """Times [us] of datagrams number `first` and later; added: of each relayed one beyond the direct one sent beside it."""
    pairs = np.array(
        [
            (took["direct"][number], relayed_ns)
            for took in found
            for number, relayed_ns in took["relayed"].items()
            if number >= first and number in took["direct"]
        ]
    )
    if not len(pairs):
        raise Problem("nothing came back through the relay")
    direct, relayed = pairs[:, 0] * 1e-3, pairs[:, 1] * 1e-3
    times = {"direct_us": direct, "relayed_us": relayed, "added_us": relayed - direct}
    return {"datagrams": len(pairs), **{name: _percentiles(us) for name, us in times.items()}}


def _table(answer: dict[str, Any]) -> Table:
    rows = []
    for direction in ("up", "down"):
        each = answer[direction]
        for kind in ("direct", "relayed", "added"):
            values = each[f"{kind}_us"]
            rows.append([direction, kind, f"{each['datagrams']}", *(f"{values[name]:.1f}" for name in PERCENTILES)])
        ratios = [each["relayed_us"][name] / each["direct_us"][name] for name in PERCENTILES]
        rows.append([direction, "relayed / direct", "", *(f"{ratio:.1f}" for ratio in ratios)])
    return plain_table(("direction", "", "datagrams", *PERCENTILES), rows, left=2, gap=2)
