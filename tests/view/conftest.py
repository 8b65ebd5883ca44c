"""A browser for the tests of the page. Without one they are skipped by name."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.view.browser_page import BrowserPage
from tests.view.browser_program import NoBrowserError, launched


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Yield a browser without a window, whose pictures are drawn in software."""
    try:
        with launched() as browser:
            yield browser
    except NoBrowserError as error:
        pytest.skip(str(error))


def opener(chromium: Any) -> Iterator[Callable[..., BrowserPage]]:
    """Yield a function that opens an address; at the end no page may have broken its policy or logged an error."""
    pages: list[BrowserPage] = []

    def open_(address: str, **context: Any) -> BrowserPage:
        pages.append(BrowserPage(chromium, address, **context))
        return pages[-1]

    yield open_
    for page in pages:
        page.close()
        assert page.errors == []


open_page = pytest.fixture(opener, name="open_page")
open_shared_page = pytest.fixture(opener, name="open_shared_page", scope="module")
"""For a page that all tests of a module look at: to open one takes a second of processor time."""
