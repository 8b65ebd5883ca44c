"""Pages of other origins open a session for Foxglove's protocol, and nothing else: as judged, and in a real browser."""

import queue
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from cogrip.cli.session.front_ends import front_ends
from cogrip.cli.terminal.problem import BadInput
from cogrip.machine.stop import Stop
from cogrip.view.access import FOXGLOVE, FRONT_ENDS, SOCKET, Access
from cogrip.view.io.feed import RecordedFeed
from cogrip.view.io.process import ViewProcess
from cogrip.view.recording import open_view

from tests.view.browser_page import Open
from tests.view.recorded_runs import recorded_run

HERE, LIMIT_S = "127.0.0.1:8123", 20.0
OWN, THEIRS = "https://lichtblick.example:8443", "https://evil.example"
PAGE = "<!DOCTYPE html><link rel=icon href='data:,'><title>front end</title>"
CONNECTED = """(address) => new Promise((resolve) => {
  const socket = new WebSocket(address, ["foxglove.sdk.v1"]);
  socket.onmessage = (event) => { socket.close(); resolve(JSON.parse(event.data).op); };
  socket.onclose = () => resolve("refused");
})"""


@pytest.mark.parametrize(
    ("origin", "offered", "allowed"),
    [
        ("https://app.foxglove.dev", True, True),
        ("https://APP.foxglove.dev", True, True),
        ("http://app.foxglove.dev", True, False),
        ("https://app.foxglove.dev.evil.example", True, False),
        ("file://", True, True),
        ("null", True, True),
        ("http://localhost:8080", True, True),
        ("https://127.0.0.1", True, True),
        ("http://[::1]:3000", True, True),
        ("http://localhost.evil.example", True, False),
        ("http://localhost@evil.example", True, False),
        ("http://localhost:port", True, False),
        ("ftp://localhost", True, False),
        (OWN, True, True),
        (THEIRS, True, False),
        ("", True, False),
        ("https://app.foxglove.dev", False, False),
        ("http://localhost:8080", False, False),
        ("null", False, False),
    ],
)
def test_front_ends_may_ask_for_their_socket_alone(origin: str, offered: bool, allowed: bool) -> None:
    access = Access([HERE], front_ends=front_ends(offered, (OWN,) if offered else ()))
    assert (access.refusal(HERE, origin, FOXGLOVE, upgrade=True) == "") == allowed
    for path in (SOCKET, "/"):
        assert access.refusal(HERE, origin, path, upgrade=path == SOCKET)
    assert access.refusal("evil.example", origin, FOXGLOVE, upgrade=True), "whatever the Origin, Host is this page's"
    assert access.refused["Origin is not this page's (socket)"] == (1 if allowed else 2)


@pytest.mark.parametrize(
    "origin", ["lichtblick.example", "https://", "https://a/b", "https://a/", "ws://a", "null", "*", ""]
)
def test_what_is_no_origin_is_refused_in_words(origin: str) -> None:
    with pytest.raises(BadInput, match="is no origin"):
        front_ends(True, (origin,))


def test_origins_go_with_foxglove() -> None:
    assert front_ends(False, ()) == ()
    assert front_ends(True, (OWN,)) == (*FRONT_ENDS, OWN)
    with pytest.raises(BadInput, match="goes with --foxglove"):
        front_ends(False, (OWN,))


def test_front_ends_in_a_browser(open_page: Open, tmp_path: Path) -> None:
    """Pages on a disk, on another port of this machine, on Foxglove's site and on one that was named; no other one."""
    (site := tmp_path / "site").mkdir()
    (site / "index.html").write_text(PAGE)
    feed = RecordedFeed(open_view(recorded_run(tmp_path / "run", 0.5)))
    with viewed(feed) as (address, counts), served(site) as elsewhere:
        page = open_page(f"{elsewhere}/")
        assert page.state(f"({CONNECTED})({address!r})") == "serverInfo"
        assert page.state(f"({CONNECTED})({address.partition('?')[0]!r})") == "refused", "without a token"
        page = open_page((site / "index.html").as_uri(), offline=False)  # in a context of its own, for its permissions
        assert page.state(f"({CONNECTED})({address!r})") == "serverInfo"
        with suppress(Exception):  # A browser that does not ask has no such permission.
            page.context.grant_permissions(["local-network-access"])
        for origin, answer in ((FRONT_ENDS[0], "serverInfo"), (OWN, "serverInfo"), (THEIRS, "refused")):
            page.tab.route(f"{origin}/**", lambda route: route.fulfill(body=PAGE, content_type="text/html"))
            page.tab.goto(f"{origin}/")
            assert page.state("origin") == origin
            assert page.state(f"({CONNECTED})({address!r})") == answer
    assert counts["Origin is not this page's (socket)"] == 1
    assert counts["token"] == 1


@contextmanager
def viewed(feed: RecordedFeed) -> Iterator[tuple[str, Any]]:
    """Serve a feed with Foxglove's protocol; yield the address that is printed for it, and the counts at the end."""
    said: queue.Queue[str] = queue.Queue()
    stop = Stop()
    process = ViewProcess(feed, stop, said.put, opens=False, foxglove=True, front_ends=front_ends(True, (OWN,)))
    thread = threading.Thread(target=process.run)
    thread.start()
    try:
        said.get(timeout=LIMIT_S)
        yield said.get(timeout=LIMIT_S).partition(": ")[2], process.counts
    finally:
        stop.reason = "tested"
        thread.join(LIMIT_S)


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve the files of a folder on a port of their own."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder))) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://localhost:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()
