"""Summary of a run on the terminal: a row a person, then the verdict in words.

Columns that do not fit side by side stand in two tables, hands above networks; if these do not fit either, an axis a line.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.tables import Fitted, marked, plain_table, shortened
from cogrip.protocol.axes import PLACES
from cogrip.protocol.texts import shown
from cogrip.results.reading.summary_values import (
    ROUNDING_J,
    UNKNOWN,
    Summary,
    dig,
    earlier,
    energy,
    is_number,
    least_reserve,
    name_of,
    number,
    people,
    seat_sessions,
    share,
    ticks_share,
    vector,
    worst_margin,
)  # fmt: skip
from cogrip.results.verdict.verdict_text import verdict

_TONES = {"good": ("✓", "green"), "warn": ("!", "yellow"), "bad": ("✗", "red")}
_STATES = {"fault": "red", "degraded": "yellow"}
_DASH = "-"
_HAND = ("hand\nmm", "peak\nN", "felt/calc.\nN/m", "least\nreserve")
_NETWORK = ("lost/late\n/dupl.", "up/down/\nrtt99 ms", "ticks\nrun", "late p99\nµs")
_NAME_WIDTH = 12


class _Row(NamedTuple):
    """A person, or the object. hand and network: the cells below the headings of these names."""

    name: Text
    where: list[str]
    hand: list[Text]
    network: list[Text]
    state: Text
    style: str = ""


def terminal_summary(summary: Summary) -> Group:
    """Return the table and the verdict of `summary.json`. A null is shown as a dash."""
    rows = [_person(each, which, summary) for user in people(summary) for which, each in _seat_sessions(user)]
    rows.append(_object(summary))
    title = Text(shown(str(summary.get("name") or "run")), style="bold")

    def hands(between: str) -> list[list[Text]]:
        return [[_cell(between.join(row.where)), *row.hand] for row in rows]

    def networks() -> list[list[Text]]:
        return [row.network for row in rows]

    def side_by_side() -> list[Table]:
        both = [[*hand, *network] for hand, network in zip(hands(" "), networks(), strict=True)]
        return [_table((*_HAND, *_NETWORK), both, rows, states=True)]

    def two(between: str) -> list[Table]:
        first = _table(_HAND, hands(between), rows, states=True)
        return [first, _table(_NETWORK, networks(), rows, states=False)]

    tables = Fitted(side_by_side, lambda: two(" "), lambda: two("\n"))
    devices = [marked(Text(""), Text(line, style="dim"))] if (line := _device_ports(summary)) else []
    return Group(title, tables, *devices, Text(""), verdict_lines(summary))


def verdict_lines(summary: Summary) -> Group:
    """Return the verdict, a paragraph a sentence."""
    return Group(*(
        marked(Text(*_TONES[tone]), Text(shown(text), "bold red" if tone == "bad" else "")) for tone, text in verdict(summary)
    ))  # fmt: skip


def _table(headings: Sequence[str], cells: list[list[Text]], rows: list[_Row], *, states: bool) -> Table:
    lines = [[row.name, *numbers, *([row.state] if states else [])] for row, numbers in zip(rows, cells, strict=True)]
    state = ["\nstate"] if states else []
    table = plain_table(["\nperson", *headings, *state], lines, styles=[row.style for row in rows])
    if states:
        table.columns[-1].justify = "left"
    return table


def _seat_sessions(user: dict[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield every seat session of a person with its number, oldest first; 0 where there was only one."""
    before = earlier(user)
    for which, seat_session in enumerate((*before, user), 1):
        yield which if before else 0, {**seat_session, "name": name_of(user)}


def _person(user: dict[str, Any], which: int, summary: Summary) -> _Row:
    link, state = user.get("link"), user.get("state")
    rtt, name = dig(link, "rtt_ms", "p99"), shown(name_of(user))
    number_of = f" ({which})" if which else ""
    return _Row(
        Text(shortened(name, _NAME_WIDTH - len(number_of)) + number_of),
        _axes(user.get("position_m")),
        [
            _cell(number(user.get("peak_force_n"), digits=2)),
            _cell("/".join(number(user.get(f"{kind}_stiffness_npm"), digits=0) for kind in ("felt", "predicted"))),
            Text(_least_of_line(user, summary)),
        ],
        [
            _cell("/".join(number(dig(link, fate), digits=0) for fate in ("lost", "late", "duplicate"))),
            _cell("/".join(map(_short, (*(dig(user, "delay", each, "p50") for each in ("up_ms", "down_ms")), rtt)))),
            *_loop(user.get("ticks")),
        ],
        Text(shown(str(state)) if state else _DASH, style=_STATES.get(str(state), "")),
    )


def _object(summary: Summary) -> _Row:
    blank = Text("")
    hand, network = [blank] * (len(_HAND) - 1), [blank] * (len(_NETWORK) - 2)
    where = _axes(dig(summary, "object", "position_m"))
    return _Row(Text("object"), where, hand, [*network, *_loop(dig(summary, "server", "ticks"))], blank, "dim")


def _least_of_line(seat_session: dict[str, Any], summary: Summary) -> str:
    """Return the least reserve of a whole line after the first second; of a run that was not passive, a margin below 0."""
    alone = [{**seat_session, "earlier": None}]
    worst, least = worst_margin(alone), least_reserve(alone, "line_reserve_j")
    if worst and worst[0] < -ROUNDING_J and summary.get("passive") is False:
        return energy(worst[0])
    return energy(least[0]) if least else _DASH


def _device_ports(summary: Summary) -> str:
    """Return a line on the device ports, "" where nobody reported: least reserve, and most leaked to a hand, and whose."""
    users = people(summary)
    reserve, margin = least_reserve(users, "device_reserve_j"), least_reserve(users, "device_margin_j")
    if margin and margin[0] < -ROUNDING_J:  # in the first second, or with energy that was written off
        reserve = margin
    sessions = seat_sessions(users)
    leaks = [(float(row["leak_j"]), str(row.get("name") or "")) for row in sessions if is_number(row.get("leak_j"))]
    leak = max(leaks, default=None)

    def of(least: tuple[float, str]) -> str:
        return f" ({shown(least[1])})" if len(seat_sessions(users)) > 1 else ""

    parts = [f"least reserve {energy(reserve[0])}{of(reserve)}"] if reserve else []
    if leak:
        leaked = f"{energy(leak[0])} leaked to the hand at most{of(leak)}"
        parts.append(leaked if leak[0] > 0.0 else "no leak to the hand")
    claimed = ", say the clients" if any(user.get("claimed") for user in users) else ""
    return f"device ports: {', '.join(parts)}{claimed}" if parts else ""


def _loop(ticks: Any) -> list[Text]:
    return [_cell(share(ticks_share(ticks))), _cell(number(dig(ticks, "late_us", "p99"), digits=0))]


def _axes(position_m: Any) -> list[str]:
    """Return a text an axis."""
    return vector(position_m[:PLACES] if isinstance(position_m, list | tuple) else position_m, scale=1e3).split(", ")


def _short(value_ms: Any) -> str:
    return number(value_ms, digits=0 if is_number(value_ms) and value_ms >= 9.95 else 1)


def _cell(text: str) -> Text:
    """Return the text, with a dash for the words for what is unknown, which are too long for a table."""
    return Text("\n".join(shown(line) for line in text.split("\n")).replace(UNKNOWN, _DASH))
