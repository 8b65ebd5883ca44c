"""A hand by pointer as its users have it: `join --device web`, and a program that moves it. Real processes, loopback."""

import json
import os
import re
import signal
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

from cogrip.devices.web.messages import OWN_HAND, OwnHand, Pointer, decode_own_hand, encode_pointer

from tests import forked
from tests.live.conftest import Process
from tests.live.held_arms import DEMO, LIMIT_S
from tests.view.example_programs import example, started

HERE_M = (0.03, 0.0, 0.0)
NEAR_M = 1e-3
HAND = re.compile(r"  anna \w+ \S+ (\S+) \S+ force")
pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="no local sockets of whole messages")


class Page:
    """A page without its picture: the messages that it sends and takes."""

    def __init__(self, address: str, token: str) -> None:
        self.socket: ClientConnection = connect(
            f"ws://{address}/socket", subprotocols=[Subprotocol("cogrip.view.v1")], legacy=True
        )
        self.socket.send(json.dumps({"type": "hello", "token": token, "hand": True}))
        self.scene = json.loads(self.socket.recv(timeout=LIMIT_S))
        self._number = 0

    def until(self, wanted: Callable[[OwnHand], bool], holds: bool) -> OwnHand:
        """Answer each message about the hand with where it is to go, if it holds; return the first that is wanted."""
        while True:
            message = self.socket.recv(timeout=LIMIT_S)
            if not isinstance(message, bytes) or message[0] != OWN_HAND:
                continue
            hand = decode_own_hand(message)
            if wanted(hand):
                return hand
            if holds:
                self._number += 1
                self.socket.send(encode_pointer(Pointer(self._number, True, HERE_M)))


def joined(run: Callable[..., Process], serve: Callable[..., tuple[Process, int]], runs: Path) -> tuple[Process, Page]:
    _, port = serve(DEMO)
    person = run("join", f"127.0.0.1:{port}", "--device", "web", "--runs", runs, "--no-report")
    found = person.hear(r"view: http://(\S+)/#([^\s&]+)")
    person.hear(r"holds cube in room demo with web:pointer\n")  # and not the link to its page
    return person, Page(found[1], found[2])


def test_a_pointer_moves_the_object_and_lets_it_go(run, serve, tmp_path) -> None:
    person, page = joined(run, serve, tmp_path)
    assert page.scene["hand"]
    hand = page.until(lambda hand: abs(hand.position_m[0] - HERE_M[0]) < NEAR_M, holds=True)
    assert hand.state == "live"
    assert hand.taken > 0
    free = page.until(lambda hand: hand.state == "free", holds=False)  # the messages have stopped
    assert abs(free.position_m[0] - HERE_M[0]) < 0.01
    assert page.until(lambda hand: not any(hand.force_n), holds=False).state == "free"
    page.socket.close()
    person.signal(signal.SIGINT)
    assert person.end() == 0, person.said
    assert "malformed" not in person.said


def test_its_page_takes_the_options_of_a_page(run, serve, tmp_path) -> None:
    """A fixed port, Foxglove's protocol for its programs' pages and for one that is named, and no browser."""
    _, server_port = serve(DEMO)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    page = ("--port", str(port), "--foxglove", "--foxglove-origin", "https://plots.example", "--no-browser")
    person = run("join", f"127.0.0.1:{server_port}", "--device", "web", *page, "--runs", tmp_path, "--no-report")
    token = person.hear(rf"view: http://127\.0\.0\.1:{port}/#([^\s&]+)")[1]
    address = person.hear(rf"Foxglove, Lichtblick: (ws://127\.0\.0\.1:{port}/\S+)")[1]
    for origin in ("https://app.foxglove.dev", "https://plots.example"):
        with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], origin=Origin(origin)) as client:
            assert json.loads(client.recv(timeout=LIMIT_S))["op"] == "serverInfo"
    person.hear(r"holds cube in room demo with web:pointer\n")
    assert Page(f"127.0.0.1:{port}", token).scene["hand"]
    person.signal(signal.SIGINT)
    assert person.end() == 0, person.said


@pytest.mark.sample(1)
@pytest.mark.parametrize("client", ["view_client.py", "view_client.js"])
def test_an_example_client_leads_the_hand_and_prints_what_it_does(run, serve, tmp_path, client) -> None:
    """Its circle of 30 mm begins at the hand: after half a second the hand has gone sideways, and the cube with it."""
    _, port = serve(DEMO, "--set", "object.axes=3")
    person = run("join", f"127.0.0.1:{port}", "--device", "web", "--runs", tmp_path, "--no-report")
    found = person.hear(r"view: (http://\S+)")
    person.hear(r"holds cube in room demo with web:pointer\n")
    with started(example(client), found[1], "--hand") as process:
        line = ""
        while not (seen := HAND.search(line)) or float(seen[1]) < 15.0:
            line = process.stdout.readline()
            assert line, process.stderr.read()
    assert "live" in line
    person.signal(signal.SIGINT)
    assert person.end() == 0, person.said
    assert "malformed" not in person.said


def test_a_client_that_is_killed_ends_its_page(run, serve, tmp_path) -> None:
    person, page = joined(run, serve, tmp_path)
    person.signal(signal.SIGKILL)
    with pytest.raises(ConnectionClosed):
        page.until(lambda hand: False, holds=False)


def test_a_page_that_is_killed_lets_go_and_is_told_once(run, serve, tmp_path) -> None:
    person, page = joined(run, serve, tmp_path)
    page.until(lambda hand: hand.taken > 0, holds=True)
    os.kill(forked.child_of(person.popen.pid, "view"), signal.SIGKILL)
    person.hear("the page's process has ended, and the hand has let go")
    person.signal(signal.SIGINT)
    assert person.end() == 0, person.said
    assert person.said.count("the page's process has ended") == 1
    # Whether the hand held until then, or had let go after 0.1 s without a message, `test_web_device` tells apart.
