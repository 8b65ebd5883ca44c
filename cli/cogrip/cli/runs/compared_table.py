"""Table of compared runs on the terminal: the numbers of each, and the differences from the first."""

from collections.abc import Sequence

from rich.console import Group
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.tables import Fitted, marked, plain_table
from cogrip.results.comparison.differences import RunDifference


def compared_table(rows: Sequence[RunDifference], labels: Sequence[str]) -> Group:
    """Return a row a number, a group a person; `=` where a number is the same as in the first run.

    Runs have letters, explained below. Those that do not fit stand in further tables, each beside the first run.
    """
    letters = [chr(ord("A") + number) for number in range(len(labels))]
    others = range(1, len(labels))

    def in_tables_of(many: int) -> list[Table]:
        return [_table(rows, letters, others[first : first + many]) for first in range(0, len(others), many)]

    layouts = [lambda many=many: in_tables_of(many) for many in range(len(others), 0, -1)]
    legend = [marked(Text(f"{letter}:"), Text(label)) for letter, label in zip(letters, labels, strict=True)]
    return Group(Fitted(*layouts), *legend)


def _table(rows: Sequence[RunDifference], letters: Sequence[str], others: Sequence[int]) -> Table:
    headings = ["", letters[0], *(heading for number in others for heading in (letters[number], "difference"))]
    table = plain_table(headings, [], gap=2)
    for column in table.columns[3::2]:
        column.style = "dim"
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
