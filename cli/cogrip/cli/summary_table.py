"""A run's summary on the terminal: a row a person, then the verdict in words. Fits 100 columns."""

from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.shown_reserves import device_ports, least_of_line
from cogrip.protocol.messages import shown
from cogrip.sim.summary_values import (
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
from cogrip.sim.verdict import verdict

_TONES = {"good": ("✓", "green"), "warn": ("!", "yellow"), "bad": ("✗", "red")}
_STATES = {"fault": "red", "degraded": "yellow"}
_DASH = "-"
_NUMBERS = ("hand\nmm", "peak\nN", "felt/calc.\nN/m", "least\nreserve", "lost/late\n/dupl.", "up/down/\nrtt99 ms")
_LOOP = ("ticks\nrun", "late p99\nµs")


def terminal_summary(summary: Summary) -> Group:
    """What to print of `summary.json`. Whatever is null stands as a dash."""
    title = Text(shown(str(summary.get("name") or "run")), style="bold")
    table = Table(title=title, title_justify="left", header_style="dim", box=None, padding=(0, 1, 0, 0))
    table.add_column(Text("\nperson"), overflow="ellipsis", max_width=12, no_wrap=True)
    for heading in (*_NUMBERS, *_LOOP):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    table.add_column(Text("\nstate"))
    for user in people(summary):
        before = earlier(user)
        for which, sitting in enumerate((*before, user), 1):
            named = {**sitting, "name": f"{name_of(user)} ({which})"} if before else sitting
            table.add_row(*_person(named, summary))
    table.add_row(*_object(summary))
    devices = [Text(line, style="dim")] if (line := device_ports(summary)) else []
    return Group(table, *devices, Text(""), verdict_lines(summary))


def verdict_lines(summary: Summary) -> Group:
    """The verdict, a line a sentence."""
    return Group(
        *(
            Text.assemble((_TONES[tone][0], _TONES[tone][1]), " ", (shown(text), "bold red" if tone == "bad" else ""))
            for tone, text in verdict(summary)
        )
    )


def _person(user: dict[str, Any], summary: Summary) -> list[Text]:
    link, state = user.get("link"), user.get("state")
    rtt = dig(link, "rtt_ms", "p99")
    return [
        Text(shown(name_of(user))),
        _cell(_spaced(user.get("position_m"))),
        _cell(number(user.get("peak_force_n"), digits=2)),
        _cell("/".join(number(user.get(f"{kind}_stiffness_npm"), digits=0) for kind in ("felt", "predicted"))),
        Text(least_of_line(user, summary)),
        _cell("/".join(number(dig(link, fate), digits=0) for fate in ("lost", "late", "duplicate"))),
        _cell("/".join(map(_short, (*(dig(user, "delay", way, "p50") for way in ("up_ms", "down_ms")), rtt)))),
        *_loop(user.get("ticks")),
        Text(shown(str(state)) if state else _DASH, style=_STATES.get(str(state), "")),
    ]


def _object(summary: Summary) -> list[Text]:
    blank = Text("")
    where = _cell(_spaced(dig(summary, "object", "position_m")))
    row = [Text("object"), where, *[blank] * (len(_NUMBERS) - 1), *_loop(dig(summary, "server", "ticks")), blank]
    for cell in row:
        cell.stylize("dim")
    return row


def _loop(ticks: Any) -> list[Text]:
    return [_cell(share(ticks_share(ticks))), _cell(number(dig(ticks, "late_us", "p99"), digits=0))]


def _spaced(position_m: Any) -> str:
    return vector(position_m, scale=1e3).replace(",", "")


def _short(value_ms: Any) -> str:
    return number(value_ms, digits=0 if is_number(value_ms) and value_ms >= 9.95 else 1)


def _cell(text: str) -> Text:
    """The words for what is not known are too long for a table."""
    return Text(shown(text).replace(UNKNOWN, _DASH))
