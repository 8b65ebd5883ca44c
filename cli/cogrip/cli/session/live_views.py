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
from cogrip.machine.addition import add_integers
from cogrip.protocol.recording.reader import Follower, RecordedMessage, RecordingError
from cogrip.protocol.recording.records import Record, Row, SeatStep, Step, Tick
from cogrip.results.reading.folder import SERVER_RECORDING, client_recording
from cogrip.server.administration.orders import WhoOrder
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.io.control import ControlError, ask
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.recorder import step_topic

R = TypeVar("R", bound=Record)

AXES = "xyz"
ASK_EVERY_S, ASK_LIMIT_S = 1.0, 0.5
_TINTS = {"fault": "red", "degraded": "yellow", "free": "dim", "joining": "dim"}
# Headings of the reserves. A heading stands above one number, at its right edge: what several share is above the first.
_RESERVES = ("reserve\nmJ: up", "\ndown", "\nline", "\nport")
_NETWORK = ("rtt\nms", "delay\nms: up", "\ndown", "lost\nframes", "late\nticks")
_DEMO_NAME_WIDTH, _NAME_WIDTH, _ROOM_WIDTH = 12, 16, 24


class FollowedRun:
    """Newest messages of the recordings in a run folder; None where there is none yet. Writers are never slowed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._followers: dict[str, Follower] = {}
        self._steps: list[RecordedMessage] = []
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

    def _keep(self, topic: str, message: RecordedMessage) -> None:
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
        place = " ".join(components(step.object_m, 1e3, "+z.1f")) if step else "rest"
        axes = max((_axes(tick.force_n) for tick in ticks if tick), default=1)

        def part(*, hands: int | None = None, network: bool = False) -> Table:
            """Return state and hands, each in so many columns (0: an axis below another), the network's part, or both."""
            headings = ["\nperson"]
            rows: list[list[str | Text]] = [[shortened(name, _DEMO_NAME_WIDTH)] for name in self._people]
            if hands is not None:
                headings += ["\nstate", *_vector_headings("hand", "mm", hands), *_vector_headings("force", "N", hands)]
            if network:
                headings += [*_RESERVES, *_NETWORK]
            for number, (row, tick) in enumerate(zip(rows, ticks, strict=True)):
                seat = step.seats[number] if step else None
                if hands is not None:
                    row += [_state(tick.state if tick else "joining"), *(_hand(tick, hands) if tick else [])]
                if tick and network:
                    row += [*_reserves(tick, seat), *_network(tick, seat)]
            return plain_table(headings, rows, left=1 if hands is None else 2)

        tables = Fitted(
            lambda: [part(hands=axes, network=True)],
            lambda: [part(hands=axes), part(network=True)],
            lambda: [part(hands=0), part(network=True)],
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
        network = [*_reserves(tick, None), *_network(tick), _number(tick.playout_frames, ".3g")]
        of_network = (*_RESERVES, *_NETWORK, "playout\nframes")

        def of_hand(columns: int) -> tuple[list[str], list[str | Text]]:
            """Return headings and cells, which have the axes' names."""
            others = [""] * (columns - 1)
            return ["state", "hand\nmm", *others, "force\nN", *others], [
                _state(tick.state), *_hand(tick, columns, AXES)
            ]  # fmt: skip

        def one(columns: int) -> list[Table]:
            headings, cells = of_hand(columns)
            return [plain_table([*headings, *of_network], [[*cells, *network]])]

        def two(columns: int) -> list[Table]:
            headings, cells = of_hand(columns)
            return [plain_table(headings, [cells]), plain_table(of_network, [network], left=0)]

        axes = _axes(tick.force_n)
        return Group(title, Fitted(lambda: one(axes), lambda: one(0), lambda: two(axes)))


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
        if observers := add_integers(each.seat is None for each in self.roster):
            rooms.append(Text(f"{observers} observe", style="dim"))
        return Group(*rooms, _Seats(seats, height - len(rooms) - 1))

    def _ask(self) -> None:
        """Ask the server what it answers `cogrip who`; the last answer remains where it does not answer."""
        now_s = time.monotonic()
        if self._state is not None and now_s >= self._asked_s + ASK_EVERY_S:
            self._asked_s = now_s
            try:
                self.roster = ask(self._state, WhoOrder(), ASK_LIMIT_S).people
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
            _number(here.rtt_ms if here else None, "z.1f"),
            _number(lost, "d"),
        )

    def vectors(self, axes: int) -> list[str]:
        """Return proxy position and force, each in so many columns; 0: an axis below another."""
        proxy_m, force_n = (self.held.proxy_m, self.held.force_n) if self.held else (None, None)
        return [*_vector(proxy_m, 1e3, "+z6.1f", axes), *_vector(force_n, 1.0, "+z5.2f", axes)]


class _Seats(Fitted):
    """A row a seat, as many as there are lines for, those that are taken first."""

    def __init__(self, seats: Sequence[_Seat], height: int) -> None:
        axes = max((_axes(seat.held.proxy_m) for seat in seats if seat.held), default=1)

        def motion(columns: int) -> tuple[str, ...]:
            return *_vector_headings("proxy", "mm", columns), *_vector_headings("force", "N", columns)

        def cut(lines_each: int, headings: int) -> tuple[Sequence[_Seat], list[Table]]:
            most = max(1, (height - headings) // lines_each)
            if len(seats) <= most:
                return seats, []
            note = Table.grid()
            note.add_row(Text(f"and {len(seats) - most} more seats", style="dim"))
            return sorted(seats, key=lambda seat: seat.state == "free")[:most], [note]

        def about(addresses: bool) -> tuple[str, ...]:
            return "name", "state", "since", *(["address"] if addresses else []), "rtt\nms", "lost"

        def one(addresses: bool, columns: int, lines_each: int) -> list[Table]:
            some, note = cut(lines_each, 3)
            rows = [[*seat.named(), *seat.cells(addresses), *seat.vectors(columns)] for seat in some]
            return [plain_table((*about(addresses), *motion(columns)), rows, left=4 if addresses else 3), *note]

        def two(addresses: bool) -> list[Table]:
            some, note = cut(2, 5)
            rows = [[*seat.named(), *seat.cells(addresses)] for seat in some]
            second = plain_table(
                ("name", "state", *motion(axes)), [[*seat.named(), *seat.vectors(axes)] for seat in some], left=2
            )
            return [plain_table(about(addresses), rows, left=4 if addresses else 3), second, *note]

        super().__init__(
            lambda: one(True, axes, 1), lambda: two(True), lambda: one(False, axes, 1), lambda: two(False),
            lambda: one(False, 0, axes),
        )  # fmt: skip


def _room(name: str, step: Step | None, width: int) -> Text:
    """Return one line, in fewer words where it is narrow."""
    name = shortened(name, _ROOM_WIDTH)
    if step is None:
        return Text(f"room {name}: nothing is recorded yet", style="dim")
    place = " ".join(components(step.object_m, 1e3, "+z.1f"))
    ticks = f"step {step.step}, {step.late_us} µs late, {step.skipped} skipped"
    forms = (f"room {name}: object {place} mm, {ticks}", f"{name}: {place} mm, {ticks}", f"{name}: {ticks}")
    return Text(next((form for form in forms if cell_len(form) <= width), forms[-1]), style="bold")


def _state(state: str) -> Text:
    return Text(state, style=_TINTS.get(state, "green"))


def _axes(values: Row) -> int:
    """Return how many of a row's axes are shown: one at least."""
    return min(len(AXES), max(1, len(values)))


def _vector_headings(name: str, unit: str, columns: int) -> tuple[str, ...]:
    """Return a heading a column; `columns` as in `_vector`."""
    if columns <= 1:
        return (f"{name}\n{unit}",)
    return f"{name}\n{unit}: {AXES[0]}", *(f"\n{axis}" for axis in AXES[1:columns])


def _vector(values: Row | None, scale: float, form: str, columns: int, names: Sequence[str] = ("",) * 3) -> list[str]:
    """Return a text for each of so many columns; 0: one text, an axis below another, behind its name if there are names."""
    found = components(values, scale, form, names)
    if columns == 0:
        return ["\n".join(found) or "-"]
    return found + ["-"] * (columns - len(found))


def _hand(tick: Tick, columns: int, names: Sequence[str] = ("",) * 3) -> list[str]:
    """Return position and force, as `_vector` does."""
    return [
        *_vector(tick.position_m, 1e3, "+z6.1f", columns, names),
        *_vector(tick.force_n, 1.0, "+z5.2f", columns, names),
    ]


def _reserves(tick: Tick, seat: SeatStep | None) -> list[str]:
    """Return energy reserves [mJ] of uplink, downlink, whole line and device port; a dash where there is no ledger."""
    up_j, line_j = (seat.up_reserve_j, seat.line_reserve_j) if seat else (None, None)
    reserves_j = (up_j, tick.reserve_j, line_j, tick.device_reserve_j)
    return [_number(None if reserve_j is None else 1e3 * reserve_j, "z.1f") for reserve_j in reserves_j]


def _network(tick: Tick, seat: SeatStep | None = None) -> list[str]:
    """Return round trip, delays of uplink and downlink, lost frames and late ticks."""
    times = [_number(time_ms, "z.1f") for time_ms in (tick.rtt_ms, tick.up_ms, tick.down_ms)]
    return [*times, f"{tick.lost + (seat.lost if seat else 0)}", f"{tick.skipped}"]


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
