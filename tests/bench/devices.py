"""`dev.py bench devices`: live sessions with emulated arms on serial lines, beside the same with simulated devices."""

import os
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

from cogrip.cli.session.settings_file import load
from cogrip.cli.session.shipped_settings import shipped
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.json_answer import Json, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.settings import Settings
from cogrip.sim.runs.folder import SUMMARY, write_settings

from tests.bench.children import output_at_end, start_cogrip, wait_for_line

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
    if not 3.0 <= seconds <= 3600.0:
        raise BadInput(f"--seconds {seconds:g} is outside 3 to 3600")
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
    busy = os.getloadavg()[0]
    if busy > _PROCESSES:
        console.print(f"the machine is busy (load {busy:.1f}): measure again when it is quiet")
    reached = _judge(found, console)
    if json is not None:
        write_json({"people": msgspec.to_builtins(found), "reached": reached}, json)
    return 0 if all(reached.values()) else 1


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
    table = Table(title="live sessions", title_justify="left")
    headings = (
        "session", "person", "ticks run", "replies missed,\nlate", "late p50/99/99.9\nµs", "work p50/99\nµs",
        "felt/calc.\nN/m", "least margin\nJ", "state",
    )  # fmt: skip
    for heading in headings:
        table.add_column(
            heading, justify="left" if heading in ("session", "person", "state") else "right", no_wrap=True
        )
    for person in found:
        stiffness = "/".join(_number(value) for value in (person.felt_npm, person.predicted_npm))
        table.add_row(
            f"{person.session}, {person.device}", person.name, f"{100 * person.run:.2f} %",
            f"{100 * person.missed:.3f} %\n{100 * person.late:.3f} %" if person.device == "serial" else "-",
            "/".join(_number(person.late_us[key]) for key in ("p50", "p99", "p999")),
            "/".join(_number(person.work_us[key]) for key in ("p50", "p99")),
            stiffness if person.session == "wall" else "-", f"{person.least_margin_j:.3g}", person.state,
        )  # fmt: skip
    return table


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
    rows = {
        "ticks run": (min(person.run for person in arms), LEAST_RUN, False),
        "replies missed (none in 5 ms)": (max(person.missed for person in arms), MOST_MISSED, True),
        "felt stiffness from predicted": (max(apart), MOST_APART, True),
    }
    reached = {}
    for what, (value, asked, most) in rows.items():
        reached[what] = value <= asked if most else value >= asked
        bound = f"at {'most' if most else 'least'} {100 * asked:g} % is asked for"
        console.print(
            f"{what}: {100 * value:.3f} %; {bound}: {'reached' if reached[what] else 'NOT reached'}", markup=False
        )
    reached["passive"] = all(person.passive and person.state == "idle" for person in arms)
    console.print(f"passive, and without a fault: {'reached' if reached['passive'] else 'NOT reached'}")
    return reached
