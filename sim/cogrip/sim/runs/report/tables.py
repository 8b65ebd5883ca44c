"""The tables of a report, as HTML. Every text is escaped here; what is not known says so."""

from collections.abc import Callable, Iterable, Sequence
from html import escape
from typing import Any

import msgspec

from cogrip.protocol.settings import Settings, User
from cogrip.sim.runs.summary_values import (
    UNKNOWN,
    Summary,
    dig,
    earlier,
    energy,
    name_of,
    number,
    people,
    share,
    sittings,
    ticks_share,
    vector,
)

Show = Callable[[dict[str, Any]], str]


def _pick(*keys: str, scale: float = 1.0, digits: int = 1) -> Show:
    return lambda user: vector(dig(user, *keys), scale=scale, digits=digits)


def _energy(key: str) -> Show:
    return lambda user: energy(dig(user, "energy", key))


def _both_ways(key: str) -> Show:
    return lambda user: " / ".join(number(dig(user, "link", direction, key), digits=0) for direction in ("up", "down"))


def _delays(which: str) -> Show:
    return lambda user: " / ".join(number(dig(user, "delay", direction, which)) for direction in ("up_ms", "down_ms"))


def _played(key: str, digits: int = 0) -> Show:
    """Where there are no waves nothing is played out."""
    return lambda user: " / ".join(
        number(dig(user, "playout", direction, key), digits=digits) for direction in ("up", "down")
    )


def _depths(user: dict[str, Any]) -> str:
    directions = [dig(user, "playout", direction) for direction in ("up", "down")]
    return " / ".join(
        f"{number(dig(direction, 'least_frames'), digits=0)} to {number(dig(direction, 'most_frames'), digits=0)}"
        if direction
        else UNKNOWN
        for direction in directions
    )


def _stiffness(key: str, missing: str) -> Show:
    """A client that was heard and tells none had none to tell."""
    return lambda user: missing if user.get(key) is None and user.get("state") else number(user.get(key), digits=0)


def _place(key: str) -> Show:
    """Where it was at the last tick, by when whoever is not live has let go."""

    def show(user: dict[str, Any]) -> str:
        where = _pick(key, scale=1e3)(user)
        return where if where == UNKNOWN or user.get("state") in (None, "live") else f"{where} (let go)"

    return show


def _yes(key: str) -> Show:
    return lambda user: {True: "yes", False: "no"}.get(user.get(key), UNKNOWN)  # type: ignore[arg-type]


def _text(key: str) -> Show:
    return lambda user: str(user[key])[:300] or "none" if user.get(key) is not None else UNKNOWN


def _percentile(which: str, key: str) -> Show:
    """A loop whose ticks are known but not this has not been timed: virtual time."""
    return lambda loop: (
        "not measured"
        if dig(loop, "ticks", which, key) is None and dig(loop, "ticks", "due")
        else number(dig(loop, "ticks", which, key))
    )


# (heading of a group, its rows: what, unit, how to show it)
_ROWS: tuple[tuple[str, tuple[tuple[str, str, Show], ...]], ...] = (
    (
        "At the last tick",
        (
            ("hand", "mm", _place("position_m")),
            ("proxy", "mm", _place("proxy_m")),
            ("force", "N", _pick("force_n", digits=2)),
            ("state", "", _text("state")),
            ("reason", "", _text("reason")),
        ),
    ),
    (
        "Over the run",
        (
            ("peak force", "N", _pick("peak_force_n", digits=2)),
            ("largest force step in a tick", "N", _pick("peak_force_step_n", digits=2)),
            ("travel", "mm", _pick("travel_m", scale=1e3, digits=0)),
            ("felt stiffness", "N/m", _stiffness("felt_stiffness_npm", "not measured")),
            ("predicted stiffness", "N/m", _stiffness("predicted_stiffness_npm", "does not apply")),
            ("rendered stiffness", "N/m", _pick("rendered_npm", digits=0)),
        ),
    ),
    (
        "Device port",
        (
            ("force oscillated", "", _yes("oscillates")),
            ("at a limit of the device", "% of ticks", _pick("at_limit", scale=100.0)),
            ("changed by its passivity controller", "% of ticks", _pick("controlled", scale=100.0)),
        ),
    ),
    (
        "Energy",
        (
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
        ),
    ),
    (
        "Link, up / down",
        (
            ("frames sent", "", _both_ways("sent")),
            ("applied", "", _both_ways("applied")),
            ("lost", "", _both_ways("lost")),
            ("late", "", _both_ways("late")),
            ("duplicate", "", _both_ways("duplicate")),
            ("pending", "", _both_ways("pending")),
            ("round trip, median", "ms", _pick("link", "rtt_ms", "p50")),
            ("round trip, 99 %", "ms", _pick("link", "rtt_ms", "p99")),
            ("one way, median", "ms", _delays("p50")),
            ("one way, 99 %", "ms", _delays("p99")),
            ("server's clock beyond the client's", "ms", _pick("delay", "clock_offset_ms", digits=2)),
            ("that is right to", "ms", _pick("delay", "uncertainty_ms", digits=2)),
        ),
    ),
    (
        "Playout, up / down",
        (
            ("depth, mean", "frames", _played("depth_frames", 2)),
            ("least to most", "frames", _depths),
            ("one frame deeper", "times", _played("repeated")),
            ("one frame shallower", "times", _played("skipped")),
            ("frames not there in time", "", _played("concealed")),
            ("of them in a row, most", "", _played("longest_gap")),
        ),
    ),
)
_LOOP: tuple[tuple[str, str, Show], ...] = (
    ("ticks run", "", lambda user: share(ticks_share(user.get("ticks")))),
    ("ticks skipped", "", lambda user: _skipped(user.get("ticks"))),
    ("lateness, median", "µs", _percentile("late_us", "p50")),
    ("lateness, 99 %", "µs", _percentile("late_us", "p99")),
    ("lateness, 99.9 %", "µs", _percentile("late_us", "p999")),
    ("lateness, most", "µs", _percentile("late_us", "max")),
    ("work a tick, median", "µs", _percentile("work_us", "p50")),
    ("work a tick, 99 %", "µs", _percentile("work_us", "p99")),
)


def _skipped(ticks: Any) -> str:
    due, run = dig(ticks, "due"), dig(ticks, "run")
    return number(due - run, digits=0) if isinstance(due, int) and isinstance(run, int) else number(None)


def people_table(summary: Summary) -> str:
    """A column a person."""
    users = sittings(people(summary))
    if not users:
        return "<p>No summary tells of them.</p>"
    names = [
        f"{name_of(user)}, sitting {number}" if earlier(user) else name_of(user)
        for user in people(summary)
        for number in range(1, len(earlier(user)) + 2)
    ]
    rows = []
    for heading, lines in (*_ROWS, ("Loop", _LOOP)):
        rows.append(f"<tr class=group><th>{escape(heading)}</th></tr>")
        rows += [row(what, unit, [show(user) for user in users]) for what, unit, show in lines]
    return table(["", *names], rows)


def room_table(summary: Summary) -> str:
    """The object at the end, the server's books and its loop."""
    thing, server = dig(summary, "object"), dig(summary, "server")
    rows = [
        row("object", "mm", [vector(dig(thing, "position_m"), scale=1e3)]),
        row("its velocity", "mm/s", [vector(dig(thing, "velocity_mps"), scale=1e3)]),
        row("its travel", "mm", [number(dig(thing, "travel_m"), scale=1e3, digits=0)]),
        row("error of the energy balance", "", [energy(dig(server, "energy_balance_error_j"))]),
    ]
    loop = {"ticks": dig(server, "ticks")}
    rows += [row(what, unit, [show(loop)]) for what, unit, show in _LOOP]
    return table([], rows)


def dropped_table(summary: Summary) -> str:
    """What went no further, or had to be dealt with, by the name of its reason."""
    dropped = dig(summary, "server", "dropped")
    if not isinstance(dropped, dict):
        return "<p>What was dropped is not known.</p>"
    counted = {reason: count for reason, count in dropped.items() if count}
    if not counted:
        return "<p>No datagram was dropped.</p>"
    return table([], [row(str(reason), "", [number(count, digits=0)]) for reason, count in counted.items()])


def settings_tables(settings: dict[str, Any]) -> str:
    """A table a section and one of the users; what is not the default is bold."""
    if not settings:
        return "<p>The settings are not known.</p>"
    usual = msgspec.to_builtins(Settings())
    sections: dict[str, list[tuple[str, Any, Any]]] = {"": []}
    for key, value in settings.items():
        if isinstance(value, dict):
            before = usual.get(key)
            sections[key] = [(inner, one, dig(before, inner)) for inner, one in value.items()]
        elif key != "users":
            sections[""].append((key, value, usual.get(key)))
    tables = [
        table([f"[{name}]" if name else "session", ""], [_setting(*line) for line in lines])
        for name, lines in sections.items()
        if lines
    ]
    users = settings.get("users")
    listed = [user for user in users if isinstance(user, dict)] if isinstance(users, list) else []
    return f"<p>Bold: not the default.</p><div class=columns>{''.join(tables)}</div>{_users(listed)}"


def _setting(key: str, value: Any, before: Any) -> str:
    mark = "" if value == before else " class=changed"
    return f"<tr><th>{escape(str(key))}</th><td{mark}>{escape(plain(value))}</td></tr>"


_WHOSE = {
    "device_hz": "as in [rates]", "power_w": "as in [admission]",
    **dict.fromkeys(
        ("impedance_nspm", "stiffness_npm", "damping_nspm", "decimator", "encoder", "compensate"), "as in [coupling]"
    ),
}  # fmt: skip
_SHORT = 8  # letters of a number that stands as it is


def _users(users: Sequence[dict[str, Any]]) -> str:
    usual = msgspec.to_builtins(User())
    keys = list(dict.fromkeys(key for user in users for key in user if key != "name"))
    keys = [key for key in keys if any(user.get(key) is not None for user in users)]
    rows = []
    for key in keys:
        cells = "".join(
            f"<td{'' if user.get(key) == usual.get(key) else ' class=changed'}>{escape(plain(user.get(key), key))}</td>"
            for user in users
        )
        rows.append(f"<tr><th>{escape(str(key))}</th>{cells}</tr>")
    return table(["users", *(name_of(user) for user in users)], rows) if rows else ""


def plain(value: Any, key: str = "") -> str:
    """A setting as it would be written, long fractions rounded; where a user has no value of their own, whose it is."""
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


def row(what: str, unit: str, cells: Iterable[str]) -> str:
    label = f"{escape(what)} <span class=unit>[{escape(unit)}]</span>" if unit else escape(what)
    text = " class=text" if what == "reason" else ""
    return f"<tr><th>{label}</th>{''.join(f'<td{text}>{escape(cell)}</td>' for cell in cells)}</tr>"


def table(head: Sequence[str], rows: Sequence[str]) -> str:
    top = f"<thead><tr>{''.join(f'<th>{escape(cell)}</th>' for cell in head)}</tr></thead>" if head else ""
    return f"<div class=wide><table>{top}<tbody>{''.join(rows)}</tbody></table></div>"
