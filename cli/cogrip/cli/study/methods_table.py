"""A comparison of methods on the terminal."""

from collections.abc import Mapping
from typing import Any

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.tables import Fitted
from cogrip.sim.experiments.methods.table import TABLE, cells, note, unstable


def methods_table(summary: Mapping[str, Any]) -> Group:
    """A row a method, a group a network; what is unstable is red. Where it is narrow the verdicts have a table of their own."""
    tables = Fitted(
        lambda: [_table(summary, verdicts=True, numbers=True)],
        lambda: [_table(summary, verdicts=True, numbers=False), _table(summary, verdicts=False, numbers=True)],
    )
    return Group(tables, Text(""), Text(note(summary, "the worst are in table.md"), style="dim"))


def _table(summary: Mapping[str, Any], *, verdicts: bool, numbers: bool) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column(Text("method"), no_wrap=True)
    if verdicts:
        table.add_column(Text("stability"))
    for column in TABLE if numbers else ():
        heading = column.heading.replace(" ", "\n")
        table.add_column(Text(f"{heading}\n{column.unit}"), justify="right", no_wrap=True)
    last = None
    for row in summary["rows"]:
        if row["network"] != last:
            last = row["network"]
            table.add_row(Text(last, style="bold"))
        verdict, *values = cells(row, worst_too=False)
        bad = unstable(row)
        table.add_row(
            Text(f"  {row['method']}"), *([Text(verdict, style="red" if bad else "")] if verdicts else []),
            *(map(Text, values) if numbers else ()),
            style="dim" if bad else "",
        )  # fmt: skip
    return table
