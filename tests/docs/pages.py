"""Read Markdown pages: headings with their anchors, tables, fenced blocks."""

import re
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def page(name: str) -> str:
    """Return the text of a page, by its path from the root of the project."""
    return (ROOT / name).read_text(encoding="utf-8")


def prose_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield (line number, line) of everything outside fenced blocks."""
    fenced = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("```"):
            fenced = not fenced
        elif not fenced:
            yield number, line


def fenced_lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield (line number, line) of everything inside fenced blocks."""
    outside = {number for number, _ in prose_lines(text)}
    for number, line in enumerate(text.splitlines(), 1):
        if number not in outside and not line.lstrip().startswith("```"):
            yield number, line


def headings(text: str) -> list[str]:
    """Return the titles of all headings."""
    return [found[1].strip() for _, line in prose_lines(text) if (found := re.match(r"#+ +(.*)", line))]


def anchor(title: str) -> str:
    """Return the anchor that GitHub gives a heading, the first of its name."""
    bare = re.sub(r"[^\w\- ]", "", title.lower())
    return bare.replace(" ", "-")


def table(text: str, first: str) -> list[list[str]]:
    """Return the rows of the first table whose header begins with `first`, each a list of cells."""
    lines = text.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(f"| {first} |"))
    rows: list[list[str]] = []
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip().strip("|").split("|")])
    return rows
