"""`dev.py bench devices`: live sessions with emulated arms on serial lines, beside the same with simulated devices."""

import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem, within
from cogrip.cli.terminal.tables import plain_table
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import SUMMARY, write_settings

from tests.bench import machine
from tests.bench.children import output_at_end, start_cogrip, wait_for_line
from tests.bench.targets import judge, reached

LEAST_RUN, MOST_MISSED, MOST_APART = 0.99, 0.001, 0.05
CARRIED = "coupling.impedance_nspm=7.9"  # what the vintage Phantom carries
WALL_S = 14.0  # the hands press from the fourth second on, and have come to rest long before the end
PULL = ("reach&amplitude_m=0.012", "reach&amplitude_m=0.012&delay_s=0.25")  # within what the motors can give
PRESS = ("reach&amplitude_m=0.008&delay_s=4&stroke_s=1&stop_s=5",) * 2
_KINDS = ("serial", "sim")
_END_LIMIT_S = 30.0
WIDTH = 120  # of the table; a narrower terminal wraps it, and nothing is left out
_PROCESSES = 2  # none of the five needs half a processor


class Person(msgspec.Struct, frozen=True):
    """The account of one person's client at the end of one session."""

    session: str
    device: str
    name: str
    ticks_due: int
    ticks_run: int
    late_us: dict[str, float | None]
    work_us: dict[str, float | None]
    counts: dict[str, int]
    felt_npm: float | None
    predicted_npm: float | None
    least_margin_j: float
    passive: bool
    state: str

    @property
    def run(self) -> float:
        """Share of the ticks."""
        return self.ticks_run / max(1, self.ticks_due)

    @property
    def missed(self) -> float:
        """Share of the replies, one a tick, that had not come 5 ms after their request, which was made again."""
        return self.counts.get("reply missed", 0) / max(1, self.ticks_run)

    @property
    def late(self) -> float:
        """Share of the ticks that did not find the reply to the request of the tick before."""
        return self.counts.get("reply late", 0) / max(1, self.ticks_run)


def bench_devices(*, seconds: float = 60.0, json: Json = None) -> int:
    """Two people pull one cube, then press on a wall: with emulated vintage Phantoms on pseudo-terminals, and with sim:phantom.

    Each arm, the server and each client is a process of its own. Exit code 0 if everything that is asked for is reached.

    Parameters
    ----------
    seconds
        How long they pull, with either device; the walls take 14 s each.
    """
    within("--seconds", seconds, 3, 3600)
    console = make_console(stderr=json == "-")
    console.width = max(console.width, WIDTH)
    cube = load(shipped("demo"), [CARRIED])
    wall = load(shipped("demo"), [CARRIED, "object.kind=wall"])
    found: list[Person] = []
    with tempfile.TemporaryDirectory(prefix="cogrip-bench-") as base:
        for name, settings, hands, length_s in (("cube", cube, PULL, seconds), ("wall", wall, PRESS, WALL_S)):
            for kind in _KINDS:
                console.print(f"{name} with {kind} devices, {length_s:g} s")
                folder = Path(base) / f"{name}-{kind}"
                found += _session(name, settings, kind, hands, length_s, folder)
    console.print(_table(found))
    busy = machine.load()
    if busy > _PROCESSES:
        console.print(f"the machine is busy (load {busy:.1f}): measure again when it is quiet")
    well = _judge(found, console)
    if json is not None:
        write_json({"people": msgspec.to_builtins(found), "reached": well}, json)
    return 0 if all(well.values()) else 1


def _session(
    name: str, settings: Settings, kind: str, hands: Sequence[str], seconds: float, folder: Path
) -> list[Person]:
    """One session, start to end. Raises Problem where a process fails."""
    write_settings(folder, settings)
    file = str(folder / "settings.json")
    with ExitStack() as stack:
        devices = [
            stack.enter_context(_device(kind, hand, folder / f"arm{number}")) for number, hand in enumerate(hands)
        ]
        server, port = stack.enter_context(_server(file, folder / "server"))
        people = [user.name for user in settings.users]
        clients = [
            start_cogrip(
                "join", f"127.0.0.1:{port}", "--name", person, "--config", file, "--device", device,
                "--seconds", str(seconds), "--runs", str(folder / person), "--no-report",
            )
            for person, device in zip(people, devices, strict=True)
        ]  # fmt: skip
        for client in clients:
            stack.callback(client.kill)  # where another one fails; does nothing to one that has ended
        said = [output_at_end(client, seconds + _END_LIMIT_S)[0] for client in clients]
        server.send_signal(signal.SIGTERM)
        output_at_end(server, _END_LIMIT_S)
    return [_person(name, kind, person, folder, words) for person, words in zip(people, said, strict=True)]


def _person(session: str, kind: str, name: str, folder: Path, said: str) -> Person:
    """From the summary that the client left. Raises Problem where it left none."""
    try:
        (path,) = (folder / name).glob(f"*/{SUMMARY}")
        summary: dict[str, Any] = msgspec.json.decode(path.read_bytes())
    except (ValueError, OSError):
        raise Problem(f"{session} with {kind} devices: {name} left no summary, but said:\n{said}") from None
    (user,) = summary["users"]
    ticks, energy = user["ticks"], user["energy"]
    margins = [energy[key] for key in ("up_margin_j", "down_margin_j", "line_margin_j")]
    return Person(
        session, kind, name, ticks["due"], ticks["run"], ticks["late_us"], ticks["work_us"], summary["server"]["dropped"],
        user["felt_stiffness_npm"], user["predicted_stiffness_npm"],
        min(margin for margin in margins if margin is not None), summary["passive"], user["state"],
    )  # fmt: skip


@contextmanager
def _device(kind: str, hand: str, link: Path) -> Iterator[str]:
    """An address; behind that of a serial line is an emulator."""
    if kind == "sim":
        yield f"sim:phantom?hand={hand}"
        return
    arm = start_cogrip("devices", "emulate", "serial", "--model", "vintage", "--hand", hand, "--link", str(link))
    try:
        wait_for_line(arm, "behind serial:")
        yield f"serial:{link}?model=vintage&pose=home"
    finally:
        arm.send_signal(signal.SIGTERM)
        output_at_end(arm, _END_LIMIT_S)


@contextmanager
def _server(file: str, runs: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The process and its port."""
    server = start_cogrip("serve", file, "--port", "0", "--runs", str(runs), "--no-report")
    try:
        yield server, wait_for_line(server, r"listening on \S+:(\d+)")[1]
    finally:
        if server.poll() is None:
            server.send_signal(signal.SIGTERM)
            output_at_end(server, _END_LIMIT_S)


def _table(found: Sequence[Person]) -> Table:
    headings = (
        "session", "person", "state", "ticks run", "replies missed,\nlate", "late p50/99/99.9\nµs", "work p50/99\nµs",
        "felt/calc.\nN/m", "least margin\nJ",
    )  # fmt: skip
    rows = [
        [
            f"{person.session}, {person.device}", person.name, person.state, f"{100 * person.run:.2f} %",
            f"{100 * person.missed:.3f} %\n{100 * person.late:.3f} %" if person.device == "serial" else "-",
            "/".join(_number(person.late_us[key]) for key in ("p50", "p99", "p999")),
            "/".join(_number(person.work_us[key]) for key in ("p50", "p99")),
            "/".join(map(_number, (person.felt_npm, person.predicted_npm))) if person.session == "wall" else "-",
            f"{person.least_margin_j:.3g}",
        ]
        for person in found
    ]  # fmt: skip
    return plain_table(headings, rows, left=3, gap=2, title="live sessions")


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.0f}"


def _judge(found: Sequence[Person], console: Console) -> dict[str, bool]:
    """Only what the arms on their lines did is held to a number."""
    arms = [person for person in found if person.device == "serial"]
    pressing = [person for person in arms if person.session == "wall"]
    apart = [
        abs(person.felt_npm / person.predicted_npm - 1.0) if person.felt_npm and person.predicted_npm else float("inf")
        for person in pressing
    ]
    for person in arms:
        counts = ", ".join(f"{name} {count}" for name, count in sorted(person.counts.items()) if count)
        console.print(f"{person.session}, {person.name}: {counts or 'nothing went wrong'}", markup=False)
    asked = {
        "ticks run": (min(person.run for person in arms), LEAST_RUN, False),
        "replies missed (none in 5 ms)": (max(person.missed for person in arms), MOST_MISSED, True),
        "felt stiffness from predicted": (max(apart), MOST_APART, True),
    }
    well = {
        what: judge(console, what, value, bound, most=most, form=".3%") for what, (value, bound, most) in asked.items()
    }
    well["passive"] = all(person.passive and person.state == "idle" for person in arms)
    console.print(f"passive, and without a fault: {reached(well['passive'])}")
    return well
