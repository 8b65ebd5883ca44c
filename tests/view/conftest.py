"""A browser for the tests of the page, without which they are skipped by name; and tests that are coroutines."""

import inspect
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Any

import pytest

from cogrip.view.scene import PageScene, to_json

from tests.view.browser_page import BrowserPage, Open, Show, Shown
from tests.view.browser_program import NoBrowserError, launched
from tests.view.event_loop import run
from tests.view.page_server import PageServer, serving


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine in an event loop of its own."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}))
    return True


@pytest.fixture(scope="session")
def chromium() -> Iterator[Any]:
    """Yield a browser without a window, whose pictures are drawn in software."""
    try:
        with launched() as browser:
            yield browser
    except NoBrowserError as error:
        pytest.skip(str(error))


def opener(chromium: Any) -> Iterator[Open]:
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


def shower(open_: Open) -> Iterator[Show]:
    """Yield a function that opens the page of a scene, which a server tells it."""
    with ExitStack() as stack:

        def show_(told: PageScene, chunks: Sequence[bytes] = (), more: str = "", **context: Any) -> Shown:
            server = stack.enter_context(serving(PageServer(to_json(told), chunks)))
            page = open_(server.address + more, **context)
            server.wait_for_page()
            page.until("cogrip.scene !== null")
            return page, server

        yield show_


@pytest.fixture
def show(open_page: Open) -> Iterator[Show]:
    yield from shower(open_page)


@pytest.fixture(scope="module")
def show_shared(open_shared_page: Open) -> Iterator[Show]:
    yield from shower(open_shared_page)
