"""Tables of a report as data, which `templates/parts.html.j2` writes as HTML; what is not known says so."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec

from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.sections import OWN_COUPLING, Settings, User
from cogrip.results.reading.summary_values import (
    UNKNOWN,
    Summary,
    dig,
    earlier,
    energy,
    is_number,
    name_of,
    number,
    people,
    seat_sessions,
    share,
    task_goals,
    task_of,
    task_result,
    ticks_share,
    vector,
)

Show = Callable[[dict[str, Any]], str]
NOT_MEASURED, DOES_NOT_APPLY, NONE = "not measured", "does not apply", "none"
_TEXT = "text"  # class of a cell that is wrapped
_CHANGED = "changed"
MOST_MARKERS = 100  # most markers that a report lists


class Cell(NamedTuple):
    """Text, and the classes of its `td`."""

    text: str
    css: str = ""


class TableRow(NamedTuple):
    """One row: its heading with a unit, and its cells."""

    label: str
    unit: str
    cells: list[Cell]


class ReportTable(NamedTuple):
    """One table: headings of its columns, and its rows; a text among the rows heads those after it."""

    head: Sequence[str]
    rows: Sequence[TableRow | str]


class SettingsTables(NamedTuple):
    """A table for each section of the settings, and one of the users."""

    sections: list[ReportTable]
    users: ReportTable


def row(label: str, cells: Iterable[str], unit: str = "", css: str = "") -> TableRow:
    """Return a row of cells of one look."""
    return TableRow(label, unit, [Cell(text, css) for text in cells])


def _at(path: str, scale: float = 1.0, digits: int = 1) -> Show:
    """Show the number, or the vector of places, at a path such as `link.rtt_ms.p50`."""

    def show(user: dict[str, Any]) -> str:
        found = dig(user, *path.split("."))
        return vector(found[:PLACES] if isinstance(found, list) else found, scale=scale, digits=digits)

    return show


def _energy(key: str) -> Show:
    return lambda user: energy(dig(user, "energy", key))


def _of_effects(key: str) -> Show:
    return lambda user: energy(dig(user, "effects", key))


def _up_down(path: str, digits: int = 0) -> Show:
    """Show the numbers of both directions, in whose places `{}` stands."""
    shown = [_at(path.format(direction), digits=digits) for direction in ("up", "down")]
    return lambda user: " / ".join(show(user) for show in shown)


def _in_use(key: str, now: str = "impedance_nspm") -> Show:
    """Show a value at the end, and its range where it has changed; 0 Hz: no filter."""

    def show(user: dict[str, Any]) -> str:
        end, least, most = [dig(user, "line", name) for name in (now, key.format("least_"), key.format("most_"))]
        shown = [number(each, digits=2) for each in (end, least, most)]
        return shown[0] if least == most else f"{shown[0]} ({shown[1]} to {shown[2]})"

    return show


def _depths(user: dict[str, Any]) -> str:
    ends = ("least_frames", "most_frames")
    directions = [dig(user, "playout", direction) for direction in ("up", "down")]
    return " / ".join(
        " to ".join(number(dig(account, end), digits=0) for end in ends) if account else UNKNOWN
        for account in directions
    )


def _stiffness(key: str, missing: str) -> Show:
    """Show a stiffness, and `missing` where a client with an account does not tell it."""
    return lambda user: missing if user.get(key) is None and user.get("state") else number(user.get(key), digits=0)


def _last_place(key: str) -> Show:
    """Show a position at the last tick, by when a client that is not live has let go."""
    where = _at(key, 1e3)

    def show(user: dict[str, Any]) -> str:
        live = user.get("state") in (None, "live")
        return text if (text := where(user)) == UNKNOWN or live else f"{text} (let go)"

    return show


def _yes_no(user: dict[str, Any]) -> str:
    said = user.get("oscillates")
    return UNKNOWN if not isinstance(said, bool) else "yes" if said else "no"


def _text(key: str) -> Show:
    return lambda user: str(user[key])[:300] or NONE if user.get(key) is not None else UNKNOWN


def _ticks(which: str, key: str) -> Show:
    """Show a percentile; in virtual time ticks are counted and not timed."""
    return lambda loop: (
        NOT_MEASURED
        if dig(loop, "ticks", which, key) is None and dig(loop, "ticks", "due")
        else number(dig(loop, "ticks", which, key))
    )


def _skipped(loop: dict[str, Any]) -> str:
    due, run = dig(loop, "ticks", "due"), dig(loop, "ticks", "run")
    return number(due - run, digits=0) if isinstance(due, int) and isinstance(run, int) else UNKNOWN


# One line of a table: heading, unit, how to show it. A heading alone begins a group.
_Line = tuple[str, str, Show]
_LOOP: tuple[_Line, ...] = (
    ("ticks run", "", lambda loop: share(ticks_share(loop.get("ticks")))),
    ("ticks skipped", "", _skipped),
    ("lateness, median", "µs", _ticks("late_us", "p50")),
    ("lateness, 99 %", "µs", _ticks("late_us", "p99")),
    ("lateness, 99.9 %", "µs", _ticks("late_us", "p999")),
    ("lateness, most", "µs", _ticks("late_us", "max")),
    ("work a tick, median", "µs", _ticks("work_us", "p50")),
    ("work a tick, 99 %", "µs", _ticks("work_us", "p99")),
)
_PERSON: tuple[_Line | str, ...] = (
    "At the last tick",
    ("hand", "mm", _last_place("position_m")),
    ("proxy", "mm", _last_place("proxy_m")),
    ("force", "N", _at("force_n", digits=2)),
    ("state", "", _text("state")),
    ("reason", "", _text("reason")),
    "Over the run",
    ("peak force", "N", _at("peak_force_n", digits=2)),
    ("largest force step in a tick", "N", _at("peak_force_step_n", digits=2)),
    ("travel", "mm", _at("travel_m", 1e3, 0)),
    ("felt stiffness", "N/m", _stiffness("felt_stiffness_npm", NOT_MEASURED)),
    ("predicted stiffness", "N/m", _stiffness("predicted_stiffness_npm", DOES_NOT_APPLY)),
    ("rendered stiffness", "N/m", _at("rendered_npm", digits=0)),
    ("wave impedance", "N s/m", _in_use("{}impedance_nspm")),
    ("wave filter", "Hz", _in_use("{}filter_hz", "wave_filter_hz")),
    "Device port",
    ("force oscillated", "", _yes_no),
    ("at a limit of the device", "% of ticks", _at("at_limit", 100.0)),
    ("changed by its passivity controller", "% of ticks", _at("controlled", 100.0)),
    "Energy",
    ("least reserve of the line up, after 1 s", "", _energy("up_reserve_j")),
    ("of the line down", "", _energy("down_reserve_j")),
    ("of the whole line", "", _energy("line_reserve_j")),
    ("of the device port", "", _energy("device_reserve_j")),
    ("least margin of the line up", "", _energy("up_margin_j")),
    ("least margin of the line down", "", _energy("down_margin_j")),
    ("least margin of the whole line", "", _energy("line_margin_j")),
    ("least of the device's work beyond the line", "", _energy("device_leak_j")),
    ("least margin of the device port", "", _energy("device_margin_j")),
    ("leak of the device port", "", lambda user: energy(user.get("leak_j"))),
    ("least in the tank of haptic effects", "", _of_effects("least_tank_j")),
    ("drawn by active effects", "", _of_effects("drawn_j")),
    ("time in which effects were less than asked for", "s", _at("effects.reduced_s", digits=3)),
    "Link, up / down",
    ("frames sent", "", _up_down("link.{}.sent")),
    ("applied", "", _up_down("link.{}.applied")),
    ("lost", "", _up_down("link.{}.lost")),
    ("late", "", _up_down("link.{}.late")),
    ("duplicate", "", _up_down("link.{}.duplicate")),
    ("pending", "", _up_down("link.{}.pending")),
    ("round trip, median", "ms", _at("link.rtt_ms.p50")),
    ("round trip, 99 %", "ms", _at("link.rtt_ms.p99")),
    ("one way, median", "ms", _up_down("delay.{}_ms.p50", 1)),
    ("one way, 99 %", "ms", _up_down("delay.{}_ms.p99", 1)),
    ("server's clock beyond the client's", "ms", _at("delay.clock_offset_ms", digits=2)),
    ("that is right to", "ms", _at("delay.uncertainty_ms", digits=2)),
    "Playout, up / down",
    ("depth, mean", "frames", _up_down("playout.{}.depth_frames", 2)),
    ("least to most", "frames", _depths),
    ("one frame deeper", "times", _up_down("playout.{}.repeated")),
    ("one frame shallower", "times", _up_down("playout.{}.skipped")),
    ("frames not there in time", "", _up_down("playout.{}.concealed")),
    ("of them in a row, most", "", _up_down("playout.{}.longest_gap")),
    "Loop",
    *_LOOP,
)
_PEAKS: dict[str, _Line] = {  # lines behind the peak force, where somebody's hand turns or grips
    "peak_torque_nm": ("peak torque", "N m", _at("peak_torque_nm", digits=3)),
    "peak_grip_n": ("peak force of the gripper", "N", _at("peak_grip_n", digits=2)),
}
_ROOM: tuple[_Line, ...] = (
    ("object", "mm", _at("object.position_m", 1e3)),
    ("its velocity", "mm/s", _at("object.velocity_mps", 1e3)),
    ("its travel", "mm", _at("object.travel_m", 1e3, 0)),
    ("error of the energy balance", "", lambda summary: energy(dig(summary, "server", "energy_balance_error_j"))),
)

_SCENE: tuple[_Line, ...] = (
    ("peak normal force at a tool", "N", _at("server.scene.peak_contact_n", digits=2)),
    ("largest slip at a tool", "mm", _at("server.scene.slip_m", 1e3, 3)),
    ("object lifted by", "mm", _at("server.scene.lifted_m", 1e3)),
    ("time lifted", "s", _at("server.scene.lifted_s", digits=2)),
    ("slip while lifted", "mm", _at("server.scene.lifted_slip_m", 1e3, 3)),
    ("object turned by", "degrees", _at("server.scene.turned_deg")),
)


_SCENE_TEXTS = (
    ("changed", "set by the scene, and stepped otherwise, so that contact creates no energy"),
    ("own", "contact that the scene sets itself, and that may create energy"),
    ("unused", "of the scene, and not used"),
)


def _rows(lines: Iterable[_Line | str], shown: Sequence[dict[str, Any]]) -> list[TableRow | str]:
    """Return the rows; one in which nothing was to be known of anybody is left out."""
    rows = [
        line if isinstance(line, str) else row(line[0], map(line[2], shown), line[1], _TEXT if line[0] == "reason" else "")
        for line in lines
    ]  # fmt: skip
    return [
        each
        for each in rows
        if isinstance(each, str) or not {cell.text for cell in each.cells} <= {NOT_MEASURED, DOES_NOT_APPLY, NONE}
    ]


def people_table(summary: Summary) -> ReportTable | str:
    """Return a column for each seat session of each person."""
    users = people(summary)
    if not users:
        return "No summary tells of them."
    names = [
        f"{name_of(user)}, seat session {number}" if earlier(user) else name_of(user)
        for user in users
        for number in range(1, len(earlier(user)) + 2)
    ]
    shown = seat_sessions(users)
    peaks = [line for key, line in _PEAKS.items() if any(is_number(each.get(key)) and each[key] for each in shown)]
    place = [line[0] for line in _PERSON].index("peak force") + 1
    return ReportTable(["", *names], _rows([*_PERSON[:place], *peaks, *_PERSON[place:]], shown))


def room_table(summary: Summary) -> ReportTable:
    """Return the object at the end, the energy balance of its steps, and the server's loop."""
    server = dig(summary, "server")
    loop = server if isinstance(server, dict) else {}
    rows = _rows(_ROOM, [summary])
    if is_number(paid_j := dig(summary, "server", "energy_limiter", "paid_j")):
        rows.append(row("taken by the energy limiter", [energy(paid_j)]))
    if isinstance(gates := summary.get("gates"), dict):
        rows.append(row("all gates may give", [energy(gates.get("budget_j"))]))
        rows.append(row("least left of it, as recorded", [energy(gates.get("margin_j"))]))
        taken_j = gates.get("taken_j")
        taken = taken_j.items() if isinstance(taken_j, dict) else ()
        rows += [row(f"most taken by {name}", [energy(value)]) for name, value in taken]
    if task := task_of(summary):
        rows.append(row(f"task with the {task.get('body')}", [task_result(task)]))
        rows += [row(f"task: {words}", [value]) for words, value in task_goals(task)]
    if isinstance(dig(summary, "server", "scene"), dict):
        rows += _rows(_SCENE, [summary])
        for key, words in _SCENE_TEXTS:
            if texts := dig(summary, "server", "scene", key):
                rows.append(row(words, ["; ".join(map(str, texts))]))
    return ReportTable([], [*rows, *_rows(_LOOP, [loop])])


def dropped_table(summary: Summary) -> ReportTable | str:
    """Return what was dropped, refused or dealt with, by the name of its reason."""
    dropped = dig(summary, "server", "dropped")
    if not isinstance(dropped, dict):
        return "What was dropped is not known."
    rows = [row(str(reason), [number(count, digits=0)]) for reason, count in dropped.items() if count]
    return ReportTable([], rows) if rows else "No datagram was dropped."


def markers_table(markers: Sequence[tuple[float, str]]) -> ReportTable | str:
    """Return the markers of a run, what was set in it among them; "" where there are none."""
    rows = [row(f"{time_s:.2f}", [text], "s", "prose") for time_s, text in markers[:MOST_MARKERS]]
    if (more := len(markers) - MOST_MARKERS) > 0:
        rows.append(row("", [f"and {more} more, which an export has"]))
    return ReportTable([], rows) if rows else ""


def settings_tables(settings: dict[str, Any]) -> SettingsTables | str:
    """Return a table for each section and one of the users; what is not the default is marked as changed.

    A setting that is empty, and is so if nobody writes it, has no row.
    """
    if not settings:
        return "The settings are not known."
    usual = msgspec.to_builtins(Settings())
    sections: dict[str, Mapping[str, Any]] = {"": {}}
    for key, value in settings.items():
        if isinstance(value, dict):
            sections[key] = value
        elif key != "users":
            sections[""] = {**sections[""], key: value}
    tables = [
        ReportTable(
            [f"[{name}]" if name else "session", ""],
            [TableRow(str(key), "", [_setting(value, dig(usual, *filter(None, (name, key))))])
             for key, value in section.items() if value not in _EMPTY or dig(usual, *filter(None, (name, key))) not in _EMPTY],
        )
        for name, section in sections.items()
        if section
    ]  # fmt: skip
    users = people(settings)
    defaults = msgspec.to_builtins(User())
    keys = dict.fromkeys(key for user in users for key in user if key != "name")
    rows = [
        TableRow(str(key), "", [_setting(user.get(key), defaults.get(key), key) for user in users])
        for key in keys
        if any(user.get(key) not in _EMPTY or defaults.get(key) not in _EMPTY for user in users)
    ]
    return SettingsTables(tables, ReportTable(["users", *map(name_of, users)], rows))


def _setting(value: Any, default: Any, key: str = "") -> Cell:
    same = list(value) == list(default) if isinstance(value, list) and isinstance(default, tuple) else value == default
    return Cell(plain(value, key), "" if same else _CHANGED)


_WHOSE = {
    "device_hz": "as in [rates]", "power_w": "as in [admission]",
    **dict.fromkeys(OWN_COUPLING, "as in [coupling]"),
}  # fmt: skip
_EMPTY: tuple[Any, ...] = (None, "", [], (), {})
_SHORT = 8  # most letters of a number that stands as it is


def plain(value: Any, key: str = "") -> str:
    """Return a setting as it would be written, long fractions rounded; for what a user does not set, where it stands."""
    if value is None:
        return _WHOSE.get(key, "not set")
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return text if len(text := str(value)) <= _SHORT else f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} = {plain(inner)}" for key, inner in value.items()) or "as above"
    if isinstance(value, list | tuple):
        return f"[{', '.join(plain(inner) for inner in value)}]"
    return str(value)
