"""The figure of the architecture: its script runs, its words do not overlap, and the committed files are what it draws."""

import itertools
import runpy
from html import escape
from pathlib import Path

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tests.docs.pages import DOCS, page

SCRIPT = runpy.run_path(str(DOCS / "figures" / "architecture.py"))


@pytest.mark.long
def test_the_script_writes_the_same_bytes_twice(tmp_path: Path) -> None:
    folders = [tmp_path / "a", tmp_path / "b"]
    for folder in folders:
        folder.mkdir()
        assert [path.name for path in SCRIPT["write"](folder)] == ["architecture.svg", "architecture.png"]
    for name in ("architecture.svg", "architecture.png"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_the_committed_picture_has_every_word_of_the_script() -> None:
    """The SVG keeps each line of text as a comment beside its outlines."""
    drawn = (DOCS / "pictures" / "architecture.svg").read_text(encoding="utf-8")
    for words in SCRIPT["draw"]().words:
        for line in filter(None, words.splitlines()):
            assert escape(line, quote=False) in drawn, line


def test_words_do_not_overlap() -> None:
    drawing = SCRIPT["draw"]()
    canvas = FigureCanvasAgg(drawing.figure)
    canvas.draw()
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in drawing.axes.texts]
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


def test_pages_show_it() -> None:
    assert "](docs/design.md)" in page("README.md")
    assert "](pictures/architecture.png)" in page("docs/design.md")
    assert "](figures/architecture.py)" in page("docs/design.md")
