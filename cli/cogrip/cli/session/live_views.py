"""Live views of `join` and `serve`: read from recordings and from what the server answers `cogrip who`."""

import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.cells import cell_len
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cogrip.cli.runs.reserve_columns import HEADING_NOW, reserves_now
from cogrip.cli.session.followed import AXES, FollowedRun, components
from cogrip.cli.terminal.tables import Fitted, shortened
from cogrip.protocol.recording.records import SeatStep, Step
from cogrip.server.io.control import ControlError, Who, ask
from cogrip.server.io.state_folder import StateFolder
from cogrip.server.roster import RosterEntry

ASK_EVERY_S, ASK_LIMIT_S = 1.0, 0.5
_TINTS = {"fault": "red", "degraded": "yellow", "free": "dim"}
_HAND = ("hand\nmm", "force\nN", HEADING_NOW)
_NETWORK = ("round\ntrip ms", "up, down\nms", "lost\nframes", "late\nticks", "playout\nframes")
_NAME_WIDTH = 16
_ROOM_WIDTH = 24


class JoinView(msgspec.Struct, frozen=True, tag="join"):
    """One's own line."""

    folder: str
    room: str
    person: str


class ServeView(msgspec.Struct, frozen=True, tag="serve"):
    """A line a seat. rooms: the names of each one's seats; state: the server's state folder, "" where it has none."""

    folder: str
    rooms: dict[str, tuple[str, ...]]
    state: str = ""


View = JoinView | ServeView


class JoinTable:
    """See `JoinView`."""

    def __init__(self, view: JoinView) -> None:
        self._view = view
        self._run = FollowedRun(Path(view.folder))

    def table(self, width: int, height: int) -> RenderableType:
        """State, hand and force of each axis with its sign, and how the network is."""
        view, tick = self._view, self._run.tick(self._view.person)
        title = Text(f"{view.person} in room {view.room}", style="bold")
        if tick is None:
            return Group(title, Text("nothing is recorded yet", style="dim"))
        hand = components(tick.position_m, 1e3, "+6.1f", AXES) or ["-"]
        force = components(tick.force_n, 1.0, "+5.2f", AXES) or ["-"]
        directions = " ".join(
            "-" if direction is None else f"{direction:.1f}" for direction in (tick.up_ms, tick.down_ms)
        )
        network = [
            _number(tick.rtt_ms, ".1f"), directions, f"{tick.lost}", f"{tick.skipped}", _number(tick.playout_frames, "d"),
        ]  # fmt: skip
        reserve = reserves_now(tick, None)
        state = Text(tick.state, style=_TINTS.get(tick.state, "green"))

        def line(between: str) -> list[Table]:
            row: tuple[str | Text, ...] = (state, between.join(hand), between.join(force), reserve, *network)
            return [_table(("state", *_HAND, *_NETWORK), [row], left=1)]

        return Group(title, Fitted(lambda: line("  "), lambda: line("\n")))


class ServeTable:
    """See `ServeView`."""

    def __init__(self, view: ServeView) -> None:
        self._view = view
        self._run = FollowedRun(Path(view.folder))
        self._state = StateFolder(Path(view.state)) if view.state else None
        self._asked_s = -ASK_EVERY_S
        self._here: dict[tuple[str, int], RosterEntry] = {}
        self._observers = 0

    def table(self, width: int, height: int) -> RenderableType:
        """Every room's object and ticks, then its seats; width, height: columns and lines there are."""
        self._ask()
        steps = {room: self._run.step(room) for room in self._view.rooms}
        several = len(self._view.rooms) > 1
        seats = [
            self._seat(room, number, name, steps[room], several)
            for room, names in self._view.rooms.items()
            for number, name in enumerate(names)
        ]
        rooms = [_room(room, step, width) for room, step in steps.items()]
        most_rooms = max(1, height // 4)
        if len(rooms) > most_rooms:
            rooms = [*rooms[:most_rooms], Text(f"and {len(rooms) - most_rooms} more rooms", style="dim")]
        if self._observers:
            rooms.append(Text(f"{self._observers} observe", style="dim"))
        return Group(*rooms, _Seats(seats, height - len(rooms) - 1))

    def _seat(self, room: str, number: int, name: str, step: Step | None, several: bool) -> "_Seat":
        here = self._here.get((room, number))
        held = step.seats[number] if step and number < len(step.seats) else None
        taken = here is not None or (self._state is None and held is not None and held.seated)
        return _Seat(
            shortened(f"{room}/{name}" if several else name, _ROOM_WIDTH if several else _NAME_WIDTH),
            ("comes" if here and not here.holds else "holds") if taken else "free",
            here,
            held if taken else None,
        )

    def _ask(self) -> None:
        """Ask the server what it answers `cogrip who`, once a second; the last answer stands where it does not answer."""
        now_s = time.monotonic()
        if self._state is None or now_s < self._asked_s + ASK_EVERY_S:
            return
        self._asked_s = now_s
        try:
            answer = ask(self._state, Who(), ASK_LIMIT_S)
        except ControlError:
            return
        self._here = {(each.room, each.seat): each for each in answer.people if each.seat is not None}
        self._observers = sum(each.seat is None for each in answer.people)


class _Seat(msgspec.Struct, frozen=True):
    name: str
    state: str
    here: RosterEntry | None
    held: SeatStep | None

    def cells(self) -> tuple[str, str, str, str]:
        """Since, address, round trip, lost."""
        here, held = self.here, self.held
        lost = here.lost if here else held.lost if held else None
        return (
            _clock(here.since_s) if here else "-", here.address if here else "-", _number(here.rtt_ms if here else None, ".1f"),
            _number(lost, "d"),
        )  # fmt: skip

    def vectors(self, between: str) -> tuple[str, str]:
        """Proxy position and force."""
        held = self.held
        return (
            between.join(components(held.proxy_m if held else None, 1e3, "+6.1f")) or "-",
            between.join(components(held.force_n if held else None, 1.0, "+5.2f")) or "-",
        )


class _Seats(Fitted):
    """A row a seat, as many as there are lines for, those that are taken first."""

    def __init__(self, seats: Sequence[_Seat], height: int) -> None:
        who = ("name", "state")
        about, motion = ("since", "address", "rtt\nms", "lost"), ("proxy\nmm", "force\nN")

        def cut(lines_each: int, headings: int) -> tuple[Sequence[_Seat], list[Table]]:
            most = max(1, (height - headings) // lines_each)
            left = len(seats) - most
            if left <= 0:
                return seats, []
            return sorted(seats, key=lambda seat: seat.state == "free")[:most], [_note(f"and {left} more seats")]

        def named(seat: _Seat) -> tuple[str | Text, ...]:
            return seat.name, Text(seat.state, style=_TINTS.get(seat.state, "green"))

        def one(addresses: bool, between: str, lines_each: int) -> list[Table]:
            some, note = cut(lines_each, 3)
            rows = [(*named(seat), *_without(seat.cells(), addresses), *seat.vectors(between)) for seat in some]
            return [_table((*who, *_without(about, addresses), *motion), rows, left=4 if addresses else 3), *note]

        def two(addresses: bool) -> list[Table]:
            some, note = cut(2, 5)
            rows = [(*named(seat), *_without(seat.cells(), addresses)) for seat in some]
            first = _table((*who, *_without(about, addresses)), rows, left=4 if addresses else 3)
            second = _table((*who, *motion), [(*named(seat), *seat.vectors(" ")) for seat in some], left=2)
            return [first, second, *note]

        axes = max((len(seat.held.proxy_m) for seat in seats if seat.held), default=1)
        super().__init__(
            lambda: one(True, " ", 1),
            lambda: two(True),
            lambda: one(False, " ", 1),
            lambda: two(False),
            lambda: one(False, "\n", axes),
        )


def _without(cells: Sequence[str], addresses: bool) -> tuple[str, ...]:
    """Since, address, round trip, lost; without the address where it is too long."""
    return tuple(cells) if addresses else (cells[0], *cells[2:])


def _room(name: str, step: Step | None, width: int) -> Text:
    """One line, in fewer words where it is narrow."""
    name = shortened(name, _ROOM_WIDTH)
    if step is None:
        return Text(f"room {name}: nothing is recorded yet", style="dim")
    place = " ".join(components(step.object_m, 1e3, "+.1f"))
    ticks = f"step {step.step}, {step.late_us} µs late, {step.skipped} skipped"
    forms = (f"room {name}: object {place} mm, {ticks}", f"{name}: {place} mm, {ticks}", f"{name}: {ticks}")
    return Text(next((form for form in forms if cell_len(form) <= width), forms[-1]), style="bold")


def _table(headings: Sequence[str], rows: Sequence[Sequence[str | Text]], left: int) -> Table:
    """left: so many columns of words, then numbers."""
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0), pad_edge=False)
    for number, heading in enumerate(headings):
        table.add_column(Text(heading), justify="left" if number < left else "right", no_wrap=True, vertical="top")
    for row in rows:
        table.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    return table


def _note(text: str) -> Table:
    table = Table.grid()
    table.add_row(Text(text, style="dim"))
    return table


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _clock(seconds: float) -> str:
    """As a watch shows it."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
