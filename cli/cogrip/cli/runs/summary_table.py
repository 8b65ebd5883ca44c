"""A run's summary on the terminal: a row a person, then the verdict in words.

What does not fit side by side stands in two tables, hands above networks; what does not even fit there, an axis a line.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.runs.reserve_columns import device_ports, least_of_line
from cogrip.cli.terminal.tables import Fitted, marked, shortened
from cogrip.protocol.messages import shown
from cogrip.sim.runs.summary_values import (
    UNKNOWN,
    Summary,
    dig,
    earlier,
    is_number,
    name_of,
    number,
    people,
    share,
    ticks_share,
    vector,
)
from cogrip.sim.runs.verdict_text import verdict

_TONES = {"good": ("✓", "green"), "warn": ("!", "yellow"), "bad": ("✗", "red")}
_STATES = {"fault": "red", "degraded": "yellow"}
_DASH = "-"
_HAND = ("hand\nmm", "peak\nN", "felt/calc.\nN/m", "least\nreserve")
_NETWORK = ("lost/late\n/dupl.", "up/down/\nrtt99 ms", "ticks\nrun", "late p99\nµs")
_NAME_WIDTH = 12


class _Row(NamedTuple):
    """A person, or the object. hand and network: as the headings of these names; hand[0] has an item an axis."""

    name: Text
    where: list[str]
    hand: list[Text]
    network: list[Text]
    state: Text
    style: str = ""


def terminal_summary(summary: Summary) -> Group:
    """What to print of `summary.json`. Whatever is null stands as a dash."""
    rows = [
        _person(seat_session, which, summary) for user in people(summary) for which, seat_session in _sittings(user)
    ]
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
    devices = [marked(Text(""), Text(line, style="dim"))] if (line := device_ports(summary)) else []
    return Group(title, tables, *devices, Text(""), verdict_lines(summary))


def verdict_lines(summary: Summary) -> Group:
    """The verdict, a paragraph a sentence."""
    return Group(
        *(
            marked(Text(*_TONES[tone]), Text(shown(text), "bold red" if tone == "bad" else ""))
            for tone, text in verdict(summary)
        )
    )


def _table(headings: Sequence[str], cells: list[list[Text]], rows: list[_Row], *, states: bool) -> Table:
    table = Table(header_style="dim", box=None, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(Text("\nperson"), overflow="ellipsis", max_width=_NAME_WIDTH, no_wrap=True)
    for heading in headings:
        table.add_column(Text(heading), justify="right", no_wrap=True)
    if states:
        table.add_column(Text("\nstate"), no_wrap=True)
    for row, numbers in zip(rows, cells, strict=True):
        table.add_row(row.name, *numbers, *([row.state] if states else []), style=row.style)
    return table


def _sittings(user: dict[str, Any]) -> Iterator[tuple[int, dict[str, Any]]]:
    """Every sitting of a person with its number, oldest first; 0 where there was only one."""
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
            Text(least_of_line(user, summary)),
        ],
        [
            _cell("/".join(number(dig(link, fate), digits=0) for fate in ("lost", "late", "duplicate"))),
            _cell(
                "/".join(
                    map(_short, (*(dig(user, "delay", direction, "p50") for direction in ("up_ms", "down_ms")), rtt))
                )
            ),
            *_loop(user.get("ticks")),
        ],
        Text(shown(str(state)) if state else _DASH, style=_STATES.get(str(state), "")),
    )


def _object(summary: Summary) -> _Row:
    blank = Text("")
    hand, network = [blank] * (len(_HAND) - 1), [blank] * (len(_NETWORK) - 2)
    where = _axes(dig(summary, "object", "position_m"))
    return _Row(Text("object"), where, hand, [*network, *_loop(dig(summary, "server", "ticks"))], blank, "dim")


def _loop(ticks: Any) -> list[Text]:
    return [_cell(share(ticks_share(ticks))), _cell(number(dig(ticks, "late_us", "p99"), digits=0))]


def _axes(position_m: Any) -> list[str]:
    """A text an axis."""
    return vector(position_m, scale=1e3).split(", ")


def _short(value_ms: Any) -> str:
    return number(value_ms, digits=0 if is_number(value_ms) and value_ms >= 9.95 else 1)


def _cell(text: str) -> Text:
    """The words for what is not known are too long for a table."""
    return Text("\n".join(shown(line) for line in text.split("\n")).replace(UNKNOWN, _DASH))
