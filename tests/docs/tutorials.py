"""Read tutorials: files that their reader saves, commands in order, and what each is shown to print."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from tests.docs.pages import DOCS, page

FENCED = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SAVED = re.compile(r"Save this as `([\w.]+)`[^\n]*\n\s*\Z")
LEFT_OUT = "..."
NAMES = tuple(f"docs/tutorials/{path.name}" for path in sorted(DOCS.glob("tutorials/*.md")) if path.name != "README.md")


@dataclass(frozen=True, slots=True)
class Saved:
    """A file that the reader saves."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class Typed:
    """A command, with pieces of what it prints, without line breaks; stays: it goes on beside the commands that follow."""

    command: str
    shown: tuple[str, ...]
    stays: bool


def plain(text: str) -> str:
    """Return a text on one line, with one sign for each number: live sessions give others, and so may another processor."""
    return re.sub(r"[−-]?\d+(?:[.:,]\d+)*", "#", " ".join(text.split()))


def steps(name: str) -> Iterator[Saved | Typed]:
    """Yield what the reader does, in order."""
    text = page(name)
    for block in FENCED.finditer(text):
        if block[1] == "console":
            yield from _typed(block[2].splitlines())
        elif saved := SAVED.search(text[: block.start()]):
            yield Saved(saved[1], block[2])


def _typed(lines: list[str]) -> Iterator[Typed]:
    terminal = lines[0].startswith("# ")  # one of its own, in which the command goes on
    command, shown = "", [""]
    for line in [*lines[terminal:], "$ "]:
        if not line.startswith("$ "):
            shown.append(f"{shown.pop()} {line.removesuffix(LEFT_OUT)}")
            if line.endswith(LEFT_OUT):  # here something is left out
                shown.append("")
            continue
        if command:
            pieces = tuple(plain(each) for each in shown if each.strip())
            yield Typed(command.removesuffix("&").strip(), pieces, terminal or command.endswith("&"))
        command, shown = line.removeprefix("$ "), [""]
