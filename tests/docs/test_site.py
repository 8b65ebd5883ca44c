"""The site that `python3 dev.py site` builds: complete, without a broken link, with nothing from another host."""

import functools
import http.server
import re
import subprocess
import sys
import threading
import tomllib
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from docutils import nodes

import cogrip.api

from tests.docs.pages import DOCS, ROOT, page
from tests.view.browser_program import NoBrowserError, launched

LOADING = {"audio", "embed", "iframe", "img", "link", "object", "script", "source", "track", "use", "video"}
"""Elements whose address a browser asks for by itself."""
IN_STYLE = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')\s]+)""")
MATHEMATICS = re.compile(r"^```math$", re.MULTILINE)
WIDTHS = (1280, 400)
SITE_DIRECTORY = DOCS / "site"


class Page(HTMLParser):
    """The anchors of a page, where its links lead, and what it loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loads, self.formulas = {""}, list[str](), list[str](), 0
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        of = {name: value or "" for name, value in attrs}
        self.anchors |= {of[name] for name in ("id", "name") if name in of}
        self.formulas += tag == "math" and of.get("display") == "block"
        if tag == "a" and "href" in of:
            self.links.append(of["href"])
        if tag in LOADING:
            self.loads += [of[name] for name in ("src", "href", "data", "poster") if name in of]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a site that was built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    built = folder / "html"
    flags = ("-b", "html", "-c", "docs/site", "-d", folder / "read", "--fail-on-warning", "--keep-going", "--quiet")
    command = [sys.executable, "-P", "-m", "sphinx", *flags, ".", built]
    made = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    return built


@pytest.fixture(scope="module")
def read(site: Path) -> dict[Path, Page]:
    return {path.resolve(): Page(path) for path in sorted(site.rglob("*.html")) if "_downloads" not in path.parts}


@pytest.mark.long
@pytest.mark.lasts(240)
def test_every_link_of_the_site_leads_to_something(read: dict[Path, Page]) -> None:
    lost = []
    for path, each in read.items():
        for link in each.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            known = read[target].anchors if target in read else {unquote(parts.fragment)}
            if not target.is_file() or unquote(parts.fragment) not in known:
                lost.append(f"{path.name}: {link}")
    assert not lost
    assert sum(len(each.links) for each in read.values()) > 5000


@pytest.mark.long
@pytest.mark.lasts(240)
def test_nothing_is_loaded_from_another_host(site: Path, read: dict[Path, Page]) -> None:
    assert not [load for each in read.values() for load in each.loads if urlsplit(load).netloc]
    for path in (*site.rglob("*.css"), *read):
        assert not IN_STYLE.findall(path.read_text(encoding="utf-8")), path


@pytest.mark.long
@pytest.mark.lasts(240)
def test_pages_have_all_that_they_are_made_of(site: Path, read: dict[Path, Page]) -> None:
    assert (site / "index.html").is_file()
    for path in DOCS.rglob("*.md"):
        name = path.relative_to(ROOT)
        built = read[(site / name).with_suffix(".html").resolve()]
        assert built.formulas == len(MATHEMATICS.findall(page(name.as_posix()))), name
    anchors = read[(site / "docs/api_reference.html").resolve()].anchors
    assert {f"cogrip.api.{name}" for name in cogrip.api.__all__} <= anchors
    assert "cogrip.api.Session.wait_for" in anchors
    assert (site / "searchindex.js").stat().st_size > 100_000


@pytest.fixture
def address(site: Path) -> Iterator[str]:
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *words: Any) -> None: ...

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=site)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.mark.long
@pytest.mark.lasts(600)
def test_a_browser_asks_no_other_host_and_scrolls_no_page_sideways(
    address: str, read: dict[Path, Page], site: Path
) -> None:
    wide, asked = [], []
    try:
        with launched() as browser:
            for width in WIDTHS:
                context = browser.new_context(viewport={"width": width, "height": 900})
                tab = context.new_page()
                tab.on("request", lambda request: asked.append(request.url))
                for path in read:
                    name = path.relative_to(site.resolve()).as_posix()
                    tab.goto(f"{address}{name}")
                    if tab.evaluate("document.documentElement.scrollWidth > innerWidth"):
                        wide.append((width, name))
                tab.goto(f"{address}search.html?q=impedance")
                tab.wait_for_selector("#search-results li a")
                context.close()
    except NoBrowserError as error:
        pytest.skip(str(error))
    assert not wide
    assert {urlsplit(each).netloc for each in asked if not each.startswith("data:")} == {urlsplit(address).netloc}


def test_every_page_is_in_the_navigation_once() -> None:
    table = tomllib.loads((SITE_DIRECTORY / "navigation.toml").read_text(encoding="utf-8"))
    listed = [name for pages in table.values() for name in pages]
    assert len(listed) == len({*listed})
    written = {path.relative_to(ROOT).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    assert {name for name in written if "/decisions/0" not in name} == {
        name for name in listed if name.startswith("docs/")
    }


@pytest.fixture
def symbols(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SITE_DIRECTORY)
    import plain_mathematics

    return plain_mathematics


@pytest.mark.parametrize(
    ("written", "set_"),
    [
        ("T_n = M T_c", "T<sub>n</sub> = M T<sub>c</sub>"),
        ("F_k (x_{k+1} - x_k)", "F<sub>k</sub> (x<sub>k+1</sub> - x<sub>k</sub>)"),
        ("omega_w = R^T q^-1", "ω<sub>w</sub> = R<sup>T</sup> q<sup>−1</sup>"),
        ("sqrt(2/b_i) <= x'", "√(2/b<sub>i</sub>) ≤ x′"),
        ("anna's b, 'x', a file_name and some/page_of.md", "anna's b, 'x', a file_name and some/page_of.md"),
    ],
)
def test_symbols_of_a_sentence_are_set(symbols: Any, written: str, set_: str) -> None:
    tags = {nodes.subscript: "<sub>{}</sub>", nodes.superscript: "<sup>{}</sup>"}
    assert "".join(tags.get(type(each), "{}").format(each.astext()) for each in symbols.pieces(written)) == set_
