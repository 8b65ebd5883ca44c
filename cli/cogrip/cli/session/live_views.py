"""Live tables of a running session, read from its recordings as they grow and from what the server answers `cogrip who`.

`python -m cogrip.cli.session.live_views VIEW`, VIEW as JSON, draws that of `join` or `serve` (see `terminal.live_screen`).
"""

import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import msgspec
import zstandard
from rich.cells import cell_len
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.screen import draw_below
from cogrip.cli.terminal.tables import Fitted, clock, plain_table, shortened
from cogrip.protocol.recording.reader import Follower, Message, RecordingError
from cogrip.protocol.recording.records import Record, Row, SeatStep, Step, Tick
from cogrip.server.io.control import ControlError, Who, ask
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.recorder import step_topic
from cogrip.server.roster import RosterEntry
from cogrip.sim.runs.folder import SERVER_RECORDING, client_recording

R = TypeVar("R", bound=Record)

AXES = "xyz"
ASK_EVERY_S, ASK_LIMIT_S = 1.0, 0.5
_TINTS = {"fault": "red", "degraded": "yellow", "free": "dim", "joining": "dim"}
_HAND = ("hand\nmm", "force\nN", "reserve mJ: up,\ndown, line, port")
_NETWORK = ("round\ntrip ms", "up, down\nms", "lost\nframes", "late\nticks")
_DEMO_NAME_WIDTH, _NAME_WIDTH, _ROOM_WIDTH = 12, 16, 24


class FollowedRun:
    """Newest messages of the recordings in a run folder; None where there is none yet. Writers are never slowed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._followers: dict[str, Follower] = {}
        self._steps: list[Message] = []
        self._topic = ""  # of the steps that `steps` returns

    def tick(self, name: str) -> Tick | None:
        """Return the newest tick of a person's client."""
        return self._newest(client_recording(name), f"/{name}/tick", Tick)

    def step(self, room: str) -> Step | None:
        """Return the newest step of a room."""
        return self._newest(SERVER_RECORDING, step_topic(room), Step)

    def steps(self, room: str) -> list[Step]:
        """Return all steps of a room since the last call."""
        self._topic = step_topic(room)
        self.step(room)
        steps, self._steps = self._steps, []
        return [msgspec.json.decode(each.payload, type=Step) for each in steps]

    def _keep(self, topic: str, message: Message) -> None:
        if topic == self._topic:
            self._steps.append(message)

    def _newest(self, file: str, topic: str, kind: type[R]) -> R | None:
        follower = self._followers.get(file)
        try:
            if follower is None:
                follower = self._followers[file] = Follower(self._folder / file, self._keep)
            message = follower.look().get(topic)
        except (OSError, RecordingError):  # not there yet, not whole yet, or gone
            return None
        except (ValueError, IndexError, zstandard.ZstdError, struct.error):  # a damaged chunk: earlier ones are valid
            message = follower.newest.get(topic) if follower else None
        return msgspec.json.decode(message.payload, type=kind) if message else None


class JoinView(msgspec.Struct, frozen=True, tag="join"):
    """The row of one person."""

    folder: str
    room: str
    person: str


class ServeView(msgspec.Struct, frozen=True, tag="serve"):
    """A row a seat. rooms: the names of each one's seats; state: the server's state folder, "" where it has none."""

    folder: str
    rooms: dict[str, tuple[str, ...]]
    state: str = ""


View = JoinView | ServeView


def drawing(view: View) -> tuple[str, str]:
    """Return module and argument for `LiveScreen.draw`."""
    return "cogrip.cli.session.live_views", msgspec.json.encode(view).decode()


class LiveTable:
    """Table of `demo`: a row a person of one room."""

    def __init__(self, folder: Path, room: str, people: Sequence[str], run: FollowedRun | None = None) -> None:
        self._run = run or FollowedRun(folder)
        self._room = room
        self._people = people

    def everyone(self) -> bool:
        """Return whether every person's client has begun."""
        return all(self._run.tick(name) for name in self._people)

    def table(self) -> Group:
        """Return one table, or two where the columns do not fit beside each other."""
        step = self._run.step(self._room)
        ticks = [self._run.tick(name) for name in self._people]
        place = " ".join(components(step.object_m, 1e3, "+.1f")) if step else "rest"

        def part(between: str, *, hands: bool = False, network: bool = False) -> Table:
            headings = ("\nperson", "\nstate", *(_HAND if hands else ()), *(_NETWORK if network else ()))
            rows: list[list[str | Text]] = []
            for number, (name, tick) in enumerate(zip(self._people, ticks, strict=True)):
                seat = step.seats[number] if step else None
                rows.append([shortened(name, _DEMO_NAME_WIDTH), _state(tick.state if tick else "joining")])
                if tick and hands:
                    rows[-1] += _hand(tick, seat, between)
                if tick and network:
                    rows[-1] += _network(tick, seat)
            return plain_table(headings, rows, left=2)

        tables = Fitted(
            lambda: [part(" ", hands=True, network=True)],
            lambda: [part(" ", hands=True), part(" ", network=True)],
            lambda: [part("\n", hands=True), part(" ", network=True)],
        )
        return Group(Text(f"object at {place} mm"), tables)


class JoinTable:
    """Table of `JoinView`."""

    def __init__(self, view: JoinView, run: FollowedRun | None = None) -> None:
        self._view = view
        self._run = run or FollowedRun(Path(view.folder))

    def table(self, width: int, height: int) -> RenderableType:
        """Return state, hand and force of each axis with its sign, and the state of the network."""
        view, tick = self._view, self._run.tick(self._view.person)
        title = Text(f"{view.person} in room {view.room}", style="bold")
        if tick is None:
            return Group(title, Text("nothing is recorded yet", style="dim"))
        network = [*_network(tick), _number(tick.playout_frames, ".3g")]

        def line(between: str) -> list[Table]:
            row: list[str | Text] = [_state(tick.state), *_hand(tick, None, between, AXES), *network]
            return [plain_table(("state", *_HAND, *_NETWORK, "playout\nframes"), [row])]

        return Group(title, Fitted(lambda: line("  "), lambda: line("\n")))


class ServeTable:
    """Table of `ServeView`."""

    def __init__(self, view: ServeView, run: FollowedRun | None = None) -> None:
        self.roster: Sequence[RosterEntry] = ()
        """Last answer of the server, asked for once a second where it has a state folder."""
        self._view = view
        self._run = run or FollowedRun(Path(view.folder))
        self._state = StateFolder(Path(view.state)) if view.state else None
        self._asked_s = -ASK_EVERY_S

    def table(self, width: int, height: int) -> RenderableType:
        """Return every room's object and ticks, then its seats; width, height: columns and lines there are."""
        self._ask()
        steps = {room: self._run.step(room) for room in self._view.rooms}
        present = {(each.room, each.seat): each for each in self.roster if each.seat is not None}
        several = len(self._view.rooms) > 1
        seats = []
        for room, names in self._view.rooms.items():
            step = steps[room]
            for number, name in enumerate(names):
                here = present.get((room, number))
                held = step.seats[number] if step and number < len(step.seats) else None
                taken = here is not None or (self._state is None and held is not None and held.seated)
                shown = shortened(f"{room}/{name}" if several else name, _ROOM_WIDTH if several else _NAME_WIDTH)
                state = ("comes" if here and not here.holds else "holds") if taken else "free"
                seats.append(_Seat(shown, state, here, held if taken else None))
        rooms = [_room(room, step, width) for room, step in steps.items()]
        most_rooms = max(1, height // 4)
        if len(rooms) > most_rooms:
            rooms = [*rooms[:most_rooms], Text(f"and {len(rooms) - most_rooms} more rooms", style="dim")]
        if observers := sum(each.seat is None for each in self.roster):
            rooms.append(Text(f"{observers} observe", style="dim"))
        return Group(*rooms, _Seats(seats, height - len(rooms) - 1))

    def _ask(self) -> None:
        """Ask the server what it answers `cogrip who`; the last answer remains where it does not answer."""
        now_s = time.monotonic()
        if self._state is not None and now_s >= self._asked_s + ASK_EVERY_S:
            self._asked_s = now_s
            try:
                self.roster = ask(self._state, Who(), ASK_LIMIT_S).people
            except ControlError:
                return


class _Seat(msgspec.Struct, frozen=True):
    name: str
    state: str
    here: RosterEntry | None
    held: SeatStep | None

    def named(self) -> list[str | Text]:
        return [self.name, _state(self.state)]

    def cells(self, addresses: bool) -> tuple[str, ...]:
        """Return since, address, round trip, lost; without the address where it is too long."""
        here, held = self.here, self.held
        lost = here.lost if here else held.lost if held else None
        since, address = (clock(here.since_s), here.address) if here else ("-", "-")
        return (
            since,
            *([address] if addresses else []),
            _number(here.rtt_ms if here else None, ".1f"),
            _number(lost, "d"),
        )

    def vectors(self, between: str) -> tuple[str, str]:
        """Return proxy position and force."""
        proxy_m, force_n = (self.held.proxy_m, self.held.force_n) if self.held else (None, None)
        return between.join(components(proxy_m, 1e3, "+6.1f")) or "-", between.join(
            components(force_n, 1.0, "+5.2f")
        ) or "-"


class _Seats(Fitted):
    """A row a seat, as many as there are lines for, those that are taken first."""

    def __init__(self, seats: Sequence[_Seat], height: int) -> None:
        motion = ("proxy\nmm", "force\nN")

        def cut(lines_each: int, headings: int) -> tuple[Sequence[_Seat], list[Table]]:
            most = max(1, (height - headings) // lines_each)
            if len(seats) <= most:
                return seats, []
            note = Table.grid()
            note.add_row(Text(f"and {len(seats) - most} more seats", style="dim"))
            return sorted(seats, key=lambda seat: seat.state == "free")[:most], [note]

        def about(addresses: bool) -> tuple[str, ...]:
            return "name", "state", "since", *(["address"] if addresses else []), "rtt\nms", "lost"

        def one(addresses: bool, between: str, lines_each: int) -> list[Table]:
            some, note = cut(lines_each, 3)
            rows = [[*seat.named(), *seat.cells(addresses), *seat.vectors(between)] for seat in some]
            return [plain_table((*about(addresses), *motion), rows, left=4 if addresses else 3), *note]

        def two(addresses: bool) -> list[Table]:
            some, note = cut(2, 5)
            rows = [[*seat.named(), *seat.cells(addresses)] for seat in some]
            second = plain_table(
                ("name", "state", *motion), [[*seat.named(), *seat.vectors(" ")] for seat in some], left=2
            )
            return [plain_table(about(addresses), rows, left=4 if addresses else 3), second, *note]

        axes = max((len(seat.held.proxy_m) for seat in seats if seat.held), default=1)
        super().__init__(
            lambda: one(True, " ", 1), lambda: two(True), lambda: one(False, " ", 1), lambda: two(False),
            lambda: one(False, "\n", axes),
        )  # fmt: skip


def _room(name: str, step: Step | None, width: int) -> Text:
    """Return one line, in fewer words where it is narrow."""
    name = shortened(name, _ROOM_WIDTH)
    if step is None:
        return Text(f"room {name}: nothing is recorded yet", style="dim")
    place = " ".join(components(step.object_m, 1e3, "+.1f"))
    ticks = f"step {step.step}, {step.late_us} µs late, {step.skipped} skipped"
    forms = (f"room {name}: object {place} mm, {ticks}", f"{name}: {place} mm, {ticks}", f"{name}: {ticks}")
    return Text(next((form for form in forms if cell_len(form) <= width), forms[-1]), style="bold")


def _state(state: str) -> Text:
    return Text(state, style=_TINTS.get(state, "green"))


def _hand(tick: Tick, seat: SeatStep | None, between: str, names: Sequence[str] = ("",) * 3) -> list[str]:
    """Return position, force, and energy reserves [mJ] of uplink, downlink, whole line and device port.

    A dash stands for a reserve of which there is no ledger.
    """
    up_j, line_j = (seat.up_reserve_j, seat.line_reserve_j) if seat else (None, None)
    reserves_j = (up_j, tick.reserve_j, line_j, tick.device_reserve_j)
    return [
        between.join(components(tick.position_m, 1e3, "+6.1f", names)) or "-",
        between.join(components(tick.force_n, 1.0, "+5.2f", names)) or "-",
        " ".join("-" if reserve_j is None else f"{reserve_j * 1e3:.1f}" for reserve_j in reserves_j),
    ]


def _network(tick: Tick, seat: SeatStep | None = None) -> list[str]:
    """Return round trip, delays of uplink and downlink, lost frames and late ticks."""
    delays = " ".join(_number(delay_ms, ".1f") for delay_ms in (tick.up_ms, tick.down_ms))
    return [_number(tick.rtt_ms, ".1f"), delays, f"{tick.lost + (seat.lost if seat else 0)}", f"{tick.skipped}"]


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def components(values: Row | None, scale: float, form: str, names: Sequence[str] = ("",) * 3) -> list[str]:
    """Return a text an axis, with its sign, behind the axis's name if there are names."""
    return [
        f"{name}{' ' if name else ''}{format(value * scale, form)}"
        for name, value in zip(names, values or (), strict=False)
        if value is not None
    ]


def main(view_text: str) -> None:
    """Draw the view until standard input ends."""
    view: View = msgspec.json.decode(view_text, type=View)
    draw_below((JoinTable(view) if isinstance(view, JoinView) else ServeTable(view)).table)


if __name__ == "__main__":
    main(sys.argv[1])
