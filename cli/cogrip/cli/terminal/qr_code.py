"""QR codes on a terminal."""

import io

import segno
from rich.console import Console

BORDER = 1  # width of the quiet zone in modules: fewer than the 4 of the standard, which every reader takes


def qr_code(text: str, columns: int, lines: int) -> str:
    """Return a QR code of half-block characters, or a sentence where so many columns and lines are too few."""
    code = segno.make(text, error="l", boost_error=False, micro=False)
    width = code.symbol_size(scale=1, border=BORDER)[0]
    height = (width + 1) // 2
    if width > columns or height > lines:
        return f"no QR code: it needs {width} columns and {height} lines, and this terminal has {columns} and {lines}"
    out = io.StringIO()
    code.terminal(out, border=BORDER, compact=True)
    return out.getvalue().rstrip("\n")


def print_qr_code(text: str, console: Console) -> None:
    """Print a QR code where people read: on a terminal."""
    if console.is_terminal:
        width, height = console.size
        code = qr_code(text, width, height - 1)
        console.file.write(code + "\n")
        console.file.flush()
