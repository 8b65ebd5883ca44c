"""Mathematics as MathML, made while the pages are built: readers load no program for it, and its font comes with the pages."""

import shutil
from importlib.resources import files
from pathlib import Path
from typing import Any

from docutils import nodes
from math_core import LatexToMathML
from sphinx.application import Sphinx

FONT = "STIXTwoMath-Regular.ttf"
CONVERTER = LatexToMathML()  # raises an error for what it does not know


def inline(self: Any, node: nodes.Element) -> None:
    """Write a formula of a sentence."""
    self.body.append(CONVERTER.convert_with_local_state(node.astext(), displaystyle=False))
    raise nodes.SkipNode


def block(self: Any, node: nodes.Element) -> None:
    """Write a formula that stands by itself; it scrolls where it is wider than the page."""
    formula = CONVERTER.convert_with_local_state(node.astext(), displaystyle=True)
    self.body.append(f'<div class="formula" tabindex="0">{formula}</div>\n')
    raise nodes.SkipNode


def bring_font(app: Sphinx, failure: Exception | None) -> None:
    """Copy the font to the pages."""
    if failure is None and app.builder.format == "html":
        folder = Path(app.outdir, "_static")
        with files("ziamath.fonts").joinpath(FONT).open("rb") as source, (folder / FONT).open("wb") as copy:
            shutil.copyfileobj(source, copy)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    app.connect("build-finished", bring_font)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
