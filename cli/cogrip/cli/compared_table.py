"""Runs side by side on the terminal: the numbers of each, and how they differ from the first."""

from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from cogrip.sim.comparison import Difference


def compared_table(rows: Sequence[Difference], labels: Sequence[str]) -> Table:
    """A row a number, a group a person; `=` where a number is the same as in the first run."""
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0))
    table.add_column(Text(""), no_wrap=True)
    table.add_column(Text(labels[0]), justify="right", overflow="fold")
    for label in labels[1:]:
        table.add_column(Text(label), justify="right", overflow="fold")
        table.add_column(Text("difference"), justify="right", style="dim", no_wrap=True)
    who: str | None = None
    for row in rows:
        if row.who != who:
            who = row.who
            table.add_row(Text(who or "object and run", style="bold"))
        unit = f" [{row.quantity.unit}]" if row.quantity.unit else ""
        first, *others = row.shown()
        cells = [first]
        for number, text in enumerate(others, 1):
            cells += [text, row.shown_change(number)]
        table.add_row(Text(f"  {row.quantity.what}{unit}"), *map(Text, cells))
    return table
