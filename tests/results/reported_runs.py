"""Reports as tests read them: the page, its tags, and what the terminal shows."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import pytest
from matplotlib.figure import Figure
from mcap.reader import make_reader
from rich.console import Console

from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.results.reading.traces import load_run
from cogrip.results.report.page import render, write_report

SETTINGS: dict[str, Any] = {
    "name": "short",
    "seconds": 2.0,
    "link": {"delay_ms": 10, "jitter_ms": 5, "loss": 0.1},
    "playout": {"frames": 2, "tank_mj": 0.5},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "ben", "hand": "hold"}],
}


BLANK = {"png": b"\x89PNG\r\n\x1a\n", "svg": b"<?xml version='1.0'?><svg xmlns='http://www.w3.org/2000/svg'/>"}


@contextmanager
def blank_pictures() -> Iterator[None]:
    """Lay out and write no figure: that takes longer than a short session."""

    def save(figure: Figure, out: BinaryIO, **how: Any) -> None:
        out.write(BLANK[how["format"]])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        yield


class Page(HTMLParser):
    """Every tag with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))


def assert_self_contained(text: str, pictures: int) -> None:
    """Hold that a page fetches nothing, and has so many pictures inside."""
    assert not re.search(r"https?:|url\(|@import", text)
    tags = Page(text).tags
    assert not {tag for tag, _ in tags} & {"script", "link", "iframe", "object", "embed", "base"}
    sources = [str(attributes["src"]) for _, attributes in tags if "src" in attributes]
    assert len(sources) == pictures
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert not any("href" in attributes for _, attributes in tags)


def spoil_chunk(path: Path, number: int) -> None:
    """Flip a byte in the middle of a chunk of a recording."""
    body = bytearray(path.read_bytes())
    summary = make_reader(BytesIO(bytes(body))).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[number]
    body[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x55
    path.write_bytes(body)


def page_of(folder: Path) -> str:
    """Return the whole report, with its plots."""
    return write_report(folder).read_text(encoding="utf-8")


def text_of(folder: Path) -> str:
    """Return the report without plots, which take most of the time."""
    return render(load_run(folder), [])


def printed(summary: dict[str, Any], width: int = 100) -> str:
    console = Console(width=width, color_system=None)
    with console.capture() as capture:
        console.print(terminal_summary(summary))
    return capture.get()
