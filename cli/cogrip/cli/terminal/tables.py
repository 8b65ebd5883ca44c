"""Tables and lines that fit the terminal: numbers and words are never cut, further lines are indented."""

import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence

from rich.cells import cell_len, chop_cells, set_cell_size
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from cogrip.cli.terminal.output import has_width

INDENT = "  "
_NATURAL = 10_000  # width in columns that is more than any table wants
_ELLIPSIS = "…"


class Fitted:
    """The first of several layouts, each of one table or several, that fits the available width; the last where none does."""

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
    """Return the columns that `table` takes where nothing is cut or wrapped."""
    return Measurement.get(console, options.update(width=_NATURAL, max_width=_NATURAL), table).maximum


def plain_table(
    headings: Sequence[str],
    rows: Iterable[Sequence[str | Text]],
    *,
    left: int = 1,
    gap: int = 1,
    styles: Sequence[str] = (),
    title: str | None = None,
) -> Table:
    """Return a table whose cells are never wrapped: `left` columns of words, then numbers. styles: one for each row."""
    table = Table(
        title=title, title_justify="left", box=None, header_style="dim", padding=(0, gap, 0, 0), pad_edge=False
    )
    for number, heading in enumerate(headings):
        table.add_column(Text(heading), justify="left" if number < left else "right", no_wrap=True)
    for number, row in enumerate(rows):
        cells = (Text(cell) if isinstance(cell, str) else cell for cell in row)
        table.add_row(*cells, style=styles[number] if styles else "")
    return table


def clock(seconds: float) -> str:
    """Return a duration as H:MM:SS or M:SS."""
    minutes, seconds = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{seconds:02}" if hours else f"{minutes}:{seconds:02}"


def columns_table(
    headings: Sequence[str],
    rows: Sequence[Mapping[str, str]],
    *,
    right: Sequence[str] = (),
    tints: Mapping[str, Mapping[str, str]] = {},
    widest: Mapping[str, int] = {},
) -> Table:
    """Return a table of some columns of rows of text.

    right: headings of numbers; tints: heading -> text -> style; widest: columns to which names under a heading are shortened.
    """
    table = Table(box=None, header_style="dim", padding=(0, 2, 0, 0), pad_edge=False)
    for number, heading in enumerate(headings):
        # the last column is wrapped between words where even the narrowest layout has no room for it
        last = number == len(headings) - 1
        table.add_column(heading, justify="right" if heading in right else "left", no_wrap=not last, overflow="fold")
    for row in rows:
        texts = ((heading, row[heading]) for heading in headings)
        table.add_row(*(Text(shortened(text, widest.get(heading, _NATURAL)), tints.get(heading, {}).get(text, ""))
                        for heading, text in texts))  # fmt: skip
    return table


def marked(mark: Text, text: Text) -> Table:
    """Return a paragraph whose further lines stand below its first word, not below its mark."""
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(mark, text)
    return grid


def shortened(text: str, width: int) -> str:
    """Return a name in at most `width` columns; not for numbers and states."""
    if cell_len(text) <= width:
        return text
    return chop_cells(text, width - 1)[0] + _ELLIPSIS


def padded(text: str, width: int, *, right: bool = False) -> str:
    """Return `text` in exactly `width` columns; longer text unchanged."""
    missing = width - cell_len(text)
    if missing <= 0:
        return text
    return " " * missing + text if right else set_cell_size(text, width)


def wrapped(text: str, console: Console, indent: str = INDENT) -> str:
    """Return `text` wrapped between words, further lines indented; unchanged where there is no width.

    A word that is wider than the terminal, such as a path, stays whole so that it can be copied.
    """
    if "\n" in text:
        return "\n".join(wrapped(line, console, indent) for line in text.split("\n"))
    if not has_width(console) or cell_len(text) <= console.width:
        return text
    return textwrap.fill(
        text, console.width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False,
        replace_whitespace=False, drop_whitespace=True,
    )  # fmt: skip


def say(console: Console, text: str, indent: str = INDENT) -> None:
    """Print a text, wrapped."""
    console.print(wrapped(text, console, indent), markup=False, soft_wrap=True)
