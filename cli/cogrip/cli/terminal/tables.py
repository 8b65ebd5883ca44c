"""Tables and lines that fit the terminal: whole numbers, whole words, a hanging indent."""

import os
import textwrap
from collections.abc import Callable, Mapping, Sequence

from rich.cells import cell_len, chop_cells, set_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

INDENT = "  "
_NATURAL = 10_000  # columns: more than any table wants
_ELLIPSIS = "…"


class Fitted:
    """The first of several layouts, each of one table or several, that fits the width there is; the last where none does."""

    def __init__(self, *layouts: Callable[[], Sequence[Table]]) -> None:
        self._layouts = layouts

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        tables: Sequence[Table] = ()
        for layout in self._layouts:
            tables = layout()
            if all(natural_width(table, console, options) <= options.max_width for table in tables):
                break
        yield from tables


def natural_width(table: Table, console: Console, options: ConsoleOptions) -> int:
    """Columns that `table` takes where nothing is cut or wrapped."""
    return Measurement.get(console, options.update(width=_NATURAL, max_width=_NATURAL), table).maximum


def columns_table(
    headings: Sequence[str],
    rows: Sequence[Mapping[str, str]],
    *,
    right: Sequence[str] = (),
    tints: Mapping[str, Mapping[str, str]] = {},
    widest: Mapping[str, int] = {},
) -> Table:
    """Some columns of rows of text.

    right: headings of numbers; tints: heading -> text -> style; widest: columns to which names under a heading are shortened.
    """
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0), pad_edge=False)
    for number, heading in enumerate(headings):
        # the last column gives way, between words, where even the narrowest layout has no room for it
        last = number == len(headings) - 1
        table.add_column(heading, justify="right" if heading in right else "left", no_wrap=not last, overflow="fold")
    for row in rows:
        table.add_row(
            *(
                Text(
                    shortened(row[heading], widest.get(heading, _NATURAL)), tints.get(heading, {}).get(row[heading], "")
                )
                for heading in headings
            )
        )
    return table


def marked(mark: Text, text: Text) -> Table:
    """A paragraph whose further lines stand below its first word, not below its mark."""
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(mark, text)
    return grid


def shortened(text: str, width: int) -> str:
    """A name in `width` columns; never a number or a state."""
    if cell_len(text) <= width:
        return text
    return chop_cells(text, width - 1)[0] + _ELLIPSIS


def padded(text: str, width: int, *, right: bool = False) -> str:
    """`text` in exactly `width` columns; longer text stays as it is."""
    missing = width - cell_len(text)
    if missing <= 0:
        return text
    return " " * missing + text if right else set_cell_size(text, width)


def has_width(console: Console) -> bool:
    """Return whether lines are read on something that is so many columns wide: a pipe or a file is not."""
    return console.is_terminal or "COLUMNS" in os.environ


def wrapped(text: str, console: Console, indent: str = INDENT) -> str:
    """`text` on several lines that break between words, the further ones indented; as it is where there is no width.

    A word that is wider than the terminal, such as a path, stays whole so that it can be copied.
    """
    if not has_width(console) or cell_len(text) <= console.width:
        return text
    return textwrap.fill(
        text, console.width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False,
        replace_whitespace=False, drop_whitespace=True,
    )  # fmt: skip


def say(console: Console, text: str, indent: str = INDENT) -> None:
    """Print plain words, wrapped."""
    console.print(wrapped(text, console, indent), markup=False, soft_wrap=True)
