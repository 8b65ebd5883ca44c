"""A browser for the tests of the page. Without one they are skipped by name."""

import shutil
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.view.browser_page import BrowserPage

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = [
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--disable-gpu-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Yield a browser without a window, whose pictures are drawn in software."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(PROGRAMS)} is installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="no Playwright: it is a development dependency")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def open_page(chromium: Any) -> Iterator[Callable[..., BrowserPage]]:
    """Yield a function that opens an address; at the end no page may have broken its policy or logged an error."""
    pages: list[BrowserPage] = []

    def open_(address: str, **context: Any) -> BrowserPage:
        pages.append(BrowserPage(chromium, address, **context))
        return pages[-1]

    yield open_
    for page in pages:
        page.close()
        assert page.errors == []
