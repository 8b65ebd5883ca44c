"""`dev.py bench hosts`: what hosts of a Ray cluster take before and with rooms, beside ordinary servers with rooms on demand.

Memory is the proportional set size, which counts what processes share once. All hosts run on this machine.
"""

import os
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import msgspec
import psutil  # type: ignore[import-untyped]

from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.io.cluster_address import ClusterError, probe

from tests.bench.children import ROOT, start_cogrip, wait_for_line
from tests.free_ports import free_port
from tests.live.raylets import descendants, kill, ray_host

DEMO = ROOT / "configs" / "demo.toml"
LIMIT_S = 120.0
SETTLE_S = 5.0
"""Time after which what was started last is measured: Ray starts its workers ahead, and its agents in turn."""
PSS = re.compile(r"^Pss: +(\d+) kB", re.MULTILINE)
LOOPBACK = ("127.", "::1")


class Taken(msgspec.Struct, frozen=True):
    """Memory, threads and ports of some processes. ports: listening or bound, as address:port/kind."""

    what: str
    processes: int
    pss_mb: float
    threads: int
    ports: tuple[str, ...]

    @property
    def open_ports(self) -> int:
        """Count of ports that are reached from other hosts."""
        return sum(not port.startswith(LOOPBACK) for port in self.ports)


def bench_hosts(*, hosts: int = 2, rooms: int = 4, json: Json = None) -> int:
    """Measure memory, threads and ports of hosts of a Ray cluster and of their rooms, beside an ordinary server.

    Parameters
    ----------
    hosts
        How many, the head included.
    rooms
        How many, on each kind of server.
    """
    within("--hosts", hosts, 1, 4)
    within("--rooms", rooms, 1, 50)
    if sys.platform != "linux":
        raise Problem("a cluster needs Linux")
    console = make_console(stderr=json == "-")
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-", ignore_cleanup_errors=True) as base, ExitStack() as stack:
        takings, times_s = _of_cluster(Path(base), hosts, rooms, stack)
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-", ignore_cleanup_errors=True) as base, ExitStack() as stack:
        more, more_s = _of_server(Path(base), rooms, stack)
    takings, times_s = [*takings, *more], {**times_s, **more_s}
    rows = [
        (each.what, f"{each.processes}", f"{each.pss_mb:.0f}", f"{each.threads}", f"{each.open_ports}", f"{len(each.ports)}")
        for each in takings
    ]  # fmt: skip
    console.print(plain_table(("", "processes", "PSS [MB]", "threads", "ports, not\nloopback", "ports"), rows, left=1))
    for each in takings:
        if ports := [port for port in each.ports if not port.startswith(LOOPBACK)]:
            console.print(f"{each.what}: {', '.join(ports)}", markup=False, soft_wrap=True)
    console.print(plain_table(("", "s"), [(what, f"{taken_s:.2f}") for what, taken_s in times_s.items()], left=1))
    if json is not None:
        write_json({"taken": msgspec.to_builtins(takings), "times_s": times_s}, json)
    return 0


def _of_cluster(base: Path, hosts: int, rooms: int, stack: ExitStack) -> tuple[list[Taken], dict[str, float]]:
    """Measure hosts that ask for Ray's token, as the page says to start them, then a front and its rooms."""
    environ = _with_token(base)
    port = free_port()
    begun_s = time.monotonic()
    address = f"127.0.0.1:{port}"
    started = [stack.enter_context(ray_host(environ, "--head", f"--port={port}", f"--temp-dir={base}/ray")).pid]
    _until(lambda: _answers(address), "the head listens")
    times_s = {"ray start --head, until it listens": time.monotonic() - begun_s}
    started += [stack.enter_context(ray_host(environ, f"--address={address}")).pid for _ in range(hosts - 1)]
    _until(lambda: all(_workers(pid) for pid in started), "every host has its first worker")
    time.sleep(SETTLE_S)
    names = ["head", *["another host"] * (hosts - 1)]
    takings = [_taken(f"{name}, before a room", descendants(pid)) for name, pid in zip(names, started, strict=True)]
    before = _all_of(started)
    begun_s = time.monotonic()
    configs = _configs(base, rooms)
    shared = base / "shared"
    front = stack.enter_context(_cogrip(
        environ, "serve", *map(str, configs), "--cluster", f"ray://{address}", "--encrypted", "--port", str(free_port()),
        "--state", f"{base}/front", "--shared", str(shared), "--runs", f"{base}/runs", "--no-report", "--no-links",
    ))  # fmt: skip
    for _ in range(rooms):
        wait_for_line(front, r"room \w+ is served at \S+")
    times_s[f"cogrip serve --cluster, until its {rooms} rooms are served"] = time.monotonic() - begun_s
    time.sleep(SETTLE_S)
    takings.append(_taken("front and its connection", descendants(front.pid)))
    of_rooms = _rooms(started)
    more = _all_of(started) - before - of_rooms
    takings.append(_taken("directory, actors of hosts", more))
    takings.append(_taken(f"template, {rooms} rooms, their recorders", of_rooms))
    names_of_rooms = [f"room{number}" for number in range(rooms)]
    spans = [_started_anew(shared, name) for name in names_of_rooms[:3]]
    times_s["a room's process killed, until the next one serves, median"] = sorted(spans)[len(spans) // 2]
    return takings, times_s


def _of_server(base: Path, rooms: int, stack: ExitStack) -> tuple[list[Taken], dict[str, float]]:
    """Measure an ordinary server with rooms on demand, before and after they are opened."""
    environ, state = dict(os.environ), f"{base}/state"
    begun_s = time.monotonic()
    server = stack.enter_context(_cogrip(
        environ, "serve", "--template", f"{DEMO}:{rooms}", "--encrypted", "--port", str(free_port()), "--state", state,
        "--runs", f"{base}/runs", "--no-report", "--no-links",
    ))  # fmt: skip
    wait_for_line(server, r"listening on")
    times_s = {f"cogrip serve --template {DEMO.name}:{rooms}, until it listens": time.monotonic() - begun_s}
    time.sleep(SETTLE_S)
    takings = [_taken(f"ordinary server, {rooms} spare rooms", descendants(server.pid))]
    spans = []
    for number in range(rooms):
        begun_s = time.monotonic()
        with _cogrip(environ, "room", "new", "demo", "--name", f"group {number}", "--state", state) as asked:
            wait_for_line(asked, "cogrip:")
        spans.append(time.monotonic() - begun_s)
    times_s["cogrip room new, until its link is there, median"] = sorted(spans)[len(spans) // 2]
    time.sleep(SETTLE_S)
    takings.append(_taken(f"ordinary server, {rooms} open rooms", descendants(server.pid)))
    return takings, times_s


def _with_token(base: Path) -> dict[str, str]:
    """Return an environment in which Ray asks for a token of its own."""
    token = base / "auth_token"
    token.write_text(secrets.token_hex(32))
    token.chmod(0o600)
    given = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN_PATH": str(token), "RAY_USAGE_STATS_ENABLED": "0"}
    return {**os.environ, **given}


def _configs(base: Path, rooms: int) -> list[Path]:
    paths = [base / f"room{number}.toml" for number in range(rooms)]
    for path in paths:
        path.write_text(DEMO.read_text("utf-8").replace('name = "demo"', f'name = "{path.stem}"'), "utf-8")
    return paths


@contextmanager
def _cogrip(environ: dict[str, str], *words: str) -> Iterator[subprocess.Popen[str]]:
    process = start_cogrip(*words, env=environ)
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            kill(descendants(process.pid))
            process.communicate()


def _answers(address: str) -> bool:
    with suppress(ClusterError):
        probe(address)
        return True
    return False


def _workers(pid: int) -> bool:
    """Return whether Ray has started a worker there, which it does once all else of the host is there."""
    return any("ray::" in _words(each) or "default_worker" in _words(each) for each in descendants(pid))


def _words(pid: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    return ""


def _all_of(started: Sequence[int]) -> set[int]:
    return {each for pid in started for each in descendants(pid)}


def _rooms(started: Sequence[int]) -> set[int]:
    """Return the templates of the hosts with all that they have forked, and what that has started."""
    heads = [each for each in _all_of(started) if "cluster_room" in _words(each)]
    return {each for head in heads for each in descendants(head)}


def _started_anew(shared: Path, room: str) -> float:
    """Kill a room's process. Return the time until the next one serves [s]."""

    def announced() -> dict[str, Any]:
        found: dict[str, Any] = msgspec.json.decode((shared / f"room-{room}.json").read_bytes())
        return found

    before, begun_s = announced(), time.monotonic()
    psutil.Process(before["pid"]).kill()
    _until(
        lambda: (now := announced())["number"] > before["number"] and now["state"] == "served", f"{room} is served anew"
    )
    return time.monotonic() - begun_s


def _until(good: Callable[[], bool], what: str) -> None:
    limit_s = time.monotonic() + LIMIT_S
    while not good():
        if time.monotonic() > limit_s:
            raise Problem(f"not within {LIMIT_S:g} s: {what}")
        time.sleep(0.02)


def _taken(what: str, pids: Sequence[int] | Set[int]) -> Taken:
    """Return what these processes take now; one that has ended meanwhile takes nothing."""
    pss_kb = threads = count = 0
    ports: set[str] = set()
    for pid in pids:
        with suppress(OSError, psutil.Error):
            found = PSS.search(Path(f"/proc/{pid}/smaps_rollup").read_text())
            pss_kb += int(found[1]) if found else 0
            threads += len(os.listdir(f"/proc/{pid}/task"))
            count += 1
            for each in psutil.Process(pid).net_connections("inet"):
                if each.status == psutil.CONN_LISTEN or (each.type == 2 and not each.raddr):
                    ports.add(f"{each.laddr.ip}:{each.laddr.port}/{'udp' if each.type == 2 else 'tcp'}")
    return Taken(what, count, pss_kb / 1024, threads, tuple(sorted(ports)))
