"""Several tabs on one address with a hand: one moves it, the others are told so, and the next one takes over."""

import json
import socket

import msgspec

from cogrip.devices.web.messages import Pointer, decode_pointer, encode_pointer
from cogrip.view import access
from cogrip.view.frames import encode
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.page_server import HAND_ELSEWHERE, Admitted
from cogrip.view.panel import PanelMessage
from cogrip.view.scene import to_json
from cogrip.view.tab import Tab

from tests.view.browser_page import Open, Show
from tests.view.page_server import PageServer, serving
from tests.view.pictured import frame, scene
from tests.view.shown_page import BINARY, TEXT, TOKEN, RawClient, Shown, shown_page, until

HELLO = json.dumps({"type": "hello", "token": TOKEN, "hand": True}).encode()


def test_the_hand_goes_to_the_tab_that_waited_longest_and_still_waits() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    link, tabs, passed = HandLink(ours), [Tab(lambda: None) for _ in range(4)], []
    with theirs, ours:
        assert [link.take(tab, lambda number=number: passed.append(number)) for number, tab in enumerate(tabs)] == [
            True, False, False, False,
        ]  # fmt: skip
        link.leave(tabs[1])
        link.send(Pointer(1, True, (0.0, 0.0, 0.0)))
        assert passed == []
        link.leave(tabs[0])
        assert passed == [2]
        assert [link.moved_by(tab) for tab in tabs] == [False, False, True, False]
        held, released = (decode_pointer(theirs.recv(100)) for _ in range(2))
        assert held.holds
        assert not released.holds, "the device is let go before another tab has it"
        link.send(Pointer(1, True, (0.0, 0.0, 0.0)))
        assert decode_pointer(theirs.recv(100)).number == 1, "numbers begin anew with the tab"
        link.leave(tabs[2])
        link.leave(tabs[3])
        assert passed == [2, 3]
        assert link.take(tabs[0])


async def test_a_second_tab_is_told_and_takes_over() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with theirs, ours:
        theirs.setblocking(False)
        link = HandLink(ours)
        link.seat = 1
        async with shown_page() as shown:
            _let_in(shown, link)
            first, second = [await RawClient.upgraded(shown.server.port) for _ in range(2)]
            scenes = []
            for client in (first, second):
                client.send(HELLO)
                scenes.append(await _scene(client))
            assert [(each["hand"], each["own_seat"], each["note"]) for each in scenes] == [
                (True, 1, ""), (False, None, HAND_ELSEWHERE),
            ]  # fmt: skip
            first.abort()
            after = await _scene(second)
            assert (after["hand"], after["own_seat"], after["note"]) == (True, 1, "")
            second.send(encode_pointer(Pointer(1, True, (0.0, 0.0, 0.0))), BINARY)
            assert not decode_pointer(theirs.recv(100)).holds
            await until(lambda: link._number == 1)
            assert decode_pointer(theirs.recv(100)).holds
            third = await RawClient.upgraded(shown.server.port)
            third.send(HELLO)
            assert (await _scene(third))["note"] == HAND_ELSEWHERE
            third.send(encode_pointer(Pointer(1, True, (0.0, 0.0, 0.0))), BINARY)
            assert await third.closed() == access.NO_RIGHT, "a tab that waits moves nothing"
            second.abort()
            await shown.until_nobody()


def _let_in(shown: Shown, link: HandLink) -> None:
    async def admit(token: str, hand: bool, address: object) -> Admitted:
        return Admitted(shown.feed, link if hand else None)

    shown.server.admit = admit


async def _scene(client: RawClient) -> dict[str, object]:
    opcode, text = await client.read()
    assert opcode == TEXT
    return json.loads(text)


def test_the_page_says_that_another_tab_holds_and_then_how_to_hold(show: Show) -> None:
    told = scene(hand=True)
    waiting = json.loads(to_json(told)) | {"hand": False, "own_seat": None, "note": HAND_ELSEWHERE}
    page, server = show(told, more="&hand")
    server.send(json.dumps(waiting))
    server.send(encode(frame(3)))
    page.until_drawn(3)
    page.until(f"document.getElementById('own-force').textContent === {HAND_ELSEWHERE!r}")
    server.send(to_json(told))
    server.send(encode(frame(4)))
    page.until("document.getElementById('own-force').textContent.startsWith('Your device')")
    assert page.text("#note") == ""


def test_a_page_that_is_over_says_so_and_does_not_come_back(open_page: Open) -> None:
    """People are not shown live any more, and neither is the picture."""
    with serving(PageServer(to_json(scene()))) as server:
        page = open_page(server.address)
        server.wait_for_page()
        server.send(encode(frame(3)))
        page.until_drawn(3)
        page.until("document.querySelector('article strong').textContent.includes('live')")
        server.sockets[-1].close(access.OVER, "The session is over: tested")
        page.until("document.getElementById('status').textContent.startsWith('The session is over: tested.')")
        assert "not connected" in page.text("article strong")
        assert page.text("#mode") == "not connected"
        page.tab.keyboard.press("3")
        page.until("document.getElementById('time').textContent.includes('the last picture')")
        assert "not connected" in page.text("article strong"), "however often it is drawn"
        assert not server.joined.acquire(timeout=0.7), "the first attempt to come back would have been made"


def test_between_trials_and_at_the_end_of_a_study_nothing_seems_live(show: Show) -> None:
    page, server = show(scene())
    server.send(encode(frame(3)))
    page.until_drawn(3)
    server.send(_panel(PanelMessage("P01", "waiting", "trial 2 of 12")))
    page.until("document.getElementById('mode').textContent === 'between trials'")
    assert page.text("#panel h2") == "P01 – trial 2 of 12"
    assert "between trials" in page.text("article strong")
    server.send(encode(frame(4)))
    page.until("document.getElementById('mode').textContent === 'live'")
    page.until("document.querySelector('article strong').textContent.includes('live')")
    server.send(_panel(PanelMessage("P01", "over", text="The study is over.")))
    page.until("document.querySelector('#panel p').textContent === 'The study is over.'")
    server.sockets[-1].close(1001, "the view is closed")
    page.until("document.getElementById('mode').textContent === 'over'")
    assert page.state("document.getElementById('status').hidden")
    assert not server.joined.acquire(timeout=0.7)


def _panel(message: PanelMessage) -> str:
    return msgspec.json.encode(message).decode()
