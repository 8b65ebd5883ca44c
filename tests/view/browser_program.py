"""The browser of this machine, without a window; its pictures are drawn in software."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

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


PARKED = "http://127.0.0.1:9/"
"""Address of a page of no server, at the host of all others."""


class NoBrowserError(Exception):
    """There is no browser, or nothing to drive it by. The text says what is missing."""


@contextmanager
def launched() -> Iterator[Any]:
    """Yield a running browser, with the context that pages share. Raises NoBrowserError."""
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        raise NoBrowserError(f"no browser: none of {', '.join(PROGRAMS)} is installed")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise NoBrowserError("no Playwright: it is a development dependency") from None
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        try:
            _park(browser.new_context())
            yield browser
        finally:
            browser.close()


def _park(context: Any) -> None:
    """Leave a page open: its process draws those of the same host, too, each of which costs half as much then."""
    page = context.new_page()
    page.route(PARKED, lambda route: route.fulfill(body="", content_type="text/html"))
    page.goto(PARKED)
