"""Navigation by purpose, from navigation.toml, and the front page under the name that servers look for."""

import shutil
import tomllib
from pathlib import Path

from sphinx.application import Sphinx

TABLE = tomllib.loads(Path(__file__).with_name("navigation.toml").read_text(encoding="utf-8"))


def toctrees() -> str:
    """Return the navigation as it is written in a page."""
    parts = []
    for caption, pages in TABLE.items():
        lines = [f"{title} </{page}>" if title else f"/{page}" for page, title in pages.items()]
        parts.append("\n".join(["```{toctree}", ":hidden:", f":caption: {caption}", "", *lines, "```"]))
    return "\n\n".join(parts)


def add(app: Sphinx, docname: str, source: list[str]) -> None:
    """Add the navigation to the front page."""
    if docname == app.config.root_doc:
        source[0] += f"\n\n{toctrees()}\n"
    if docname == "docs/decisions/README":
        names = sorted(path.stem for path in Path(app.srcdir, "docs", "decisions").glob("[0-9]*.md"))
        source[0] += "\n".join(["\n```{toctree}", ":hidden:", "", *names, "```\n"])


def reread(app: Sphinx, env: object, added: set[str], changed: set[str], removed: set[str]) -> list[str]:
    """Return the pages that hold more than their own text."""
    return [app.config.root_doc, "docs/decisions/README", "docs/api_reference"]


def name_front_page(app: Sphinx, failure: Exception | None) -> None:
    """Copy the front page to index.html."""
    if failure is None and app.builder.name == "html":
        shutil.copyfile(Path(app.outdir, f"{app.config.root_doc}.html"), Path(app.outdir, "index.html"))


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("source-read", add)
    app.connect("env-get-outdated", reread)
    app.connect("build-finished", name_front_page)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
