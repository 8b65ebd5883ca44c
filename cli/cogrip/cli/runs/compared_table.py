"""Runs side by side on the terminal: the numbers of each, and how they differ from the first."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.tables import Fitted, marked
from cogrip.sim.runs.comparison import Difference


def compared_table(rows: Sequence[Difference], labels: Sequence[str]) -> Group:
    """A row a number, a group a person; `=` where a number is the same as in the first run.

    Runs are called by letters, explained below. Those that do not fit side by side stand in further tables, each beside the
    first run.
    """
    letters = [chr(ord("A") + number) for number in range(len(labels))]
    others = range(1, len(labels))

    def in_tables_of(many: int) -> list[Table]:
        return [_table(rows, letters, others[first : first + many]) for first in range(0, len(others), many)]

    layouts = [lambda many=many: in_tables_of(many) for many in range(len(others), 0, -1)]
    legend = [marked(Text(f"{letter}:"), Text(label)) for letter, label in zip(letters, labels, strict=True)]
    return Group(Fitted(*layouts), *legend)


def _table(rows: Sequence[Difference], letters: Sequence[str], others: Sequence[int]) -> Table:
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0), pad_edge=False)
    table.add_column(Text(""), no_wrap=True)
    table.add_column(Text(letters[0]), justify="right", no_wrap=True)
    for number in others:
        table.add_column(Text(letters[number]), justify="right", no_wrap=True)
        table.add_column(Text("difference"), justify="right", style="dim", no_wrap=True)
    who: str | None = None
    for row in rows:
        if row.who != who:
            who = row.who
            table.add_row(Text(who or "object and run", style="bold"))
        unit = f" [{row.quantity.unit}]" if row.quantity.unit else ""
        shown = row.shown()
        cells = [shown[0]]
        for number in others:
            cells += [shown[number], row.shown_change(number)]
        table.add_row(Text(f"  {row.quantity.what}{unit}"), *map(Text, cells))
    return table
