"""A comparison of methods on the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.sim.methods.table import TABLE, cells, note, unstable


def methods_table(summary: Mapping[str, Any]) -> Group:
    """A row a method, a group a network; what is unstable is red."""
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(Text("method"), no_wrap=True)
    table.add_column(Text("stability"))  # the one that gives way where a terminal is narrow
    for column in TABLE:
        heading = column.heading.replace(" ", "\n")
        table.add_column(Text(f"{heading}\n{column.unit}"), justify="right", no_wrap=True)
    last = None
    for row in summary["rows"]:
        if row["network"] != last:
            last = row["network"]
            table.add_row(Text(last, style="bold"))
        verdict, *numbers = cells(row, worst_too=False)
        bad = unstable(row)
        table.add_row(
            Text(f"  {row['method']}"), Text(verdict, style="red" if bad else ""), *(Text(number) for number in numbers),
            style="dim" if bad else "",
        )  # fmt: skip
    return Group(table, Text(""), Text(note(summary, "the worst are in table.md"), style="dim"))
