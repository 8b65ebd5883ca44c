"""Link between the page's process and the client that holds a `web:` device: datagrams over a pair of local sockets."""

import asyncio
import json
import socket
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

from cogrip.devices.web.messages import ZERO, FrameError, Pointer, decode_own_hand, encode_pointer
from cogrip.view.tab import Tab

MOST_BYTES = 4096
MOST_AT_ONCE = 64


class HandLink:
    """Page's end of the link. One tab at a time moves the hand; when it is closed the next one does that asked for it.

    seated   called when the client has got a seat
    seat     its number, None before
    """

    def __init__(self, end: socket.socket, seated: Callable[[], None] = lambda: None) -> None:
        end.setblocking(False)
        self.counts: Counter[str] = Counter()
        self.seat: int | None = None
        self._end = end
        self._seated = seated
        self._tab: Tab | None = None
        self._waiting: dict[Tab, Callable[[], None]] = {}  # in the order in which they came
        self._number = 0
        self.ended = ""  # why there is no hand any more

    def start(self) -> None:
        """Begin to listen; called in the event loop's thread."""
        asyncio.get_running_loop().add_reader(self._end, self._receive)

    def close(self) -> None:
        """Let go and close."""
        self._let_go()
        with suppress(RuntimeError, ValueError):
            asyncio.get_running_loop().remove_reader(self._end)
        self._end.close()

    def take(self, tab: Tab, passed: Callable[[], None] = lambda: None) -> bool:
        """Give the hand to a tab, if no other one has it; else `passed` is called once the tab has got it."""
        if self._tab is None:
            self._give(tab)
        else:
            self._waiting[tab] = passed
        return self.moved_by(tab)

    def moved_by(self, tab: Tab) -> bool:
        """Return whether a tab has the hand."""
        return self._tab is tab

    def leave(self, tab: Tab) -> None:
        """Let the hand go as its tab is closed, and give it to the one that has waited longest."""
        self._waiting.pop(tab, None)
        if self._tab is not tab:
            return
        self._let_go()
        self._tab = None
        for waiting in list(self._waiting)[:1]:
            passed = self._waiting.pop(waiting)
            self._give(waiting)
            passed()

    def _give(self, tab: Tab) -> None:
        self._tab = tab
        self._number = 0
        tab.own_seat = self.seat

    def send(self, pointer: Pointer) -> None:
        """Pass a pointer message on; one that is not newer than the last is late."""
        if pointer.number <= self._number:
            self.counts["late pointer message"] += 1
            return
        self._number = pointer.number
        self._put(encode_pointer(pointer))

    def _let_go(self) -> None:
        self._put(encode_pointer(Pointer(min(self._number + 1, 2**32 - 1), False, ZERO)))

    def _put(self, message: bytes) -> None:
        try:
            self._end.send(message)
        except OSError as error:  # the client is busy, or gone: the device lets go after 100 ms of silence
            self.counts[f"hand: {error.strerror}"] += 1

    def _take_seat(self, seat: int) -> None:
        self.seat = seat
        if self._tab is not None:
            self._tab.own_seat = seat
        self._seated()

    def _receive(self) -> None:
        for _ in range(MOST_AT_ONCE):
            try:
                message = self._end.recv(MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                self.ended = "the client that holds the hand has ended"
                asyncio.get_running_loop().remove_reader(self._end)
                return
            if message.startswith(b"{"):
                with suppress(ValueError, KeyError, TypeError):
                    self._take_seat(int(json.loads(message)["seat"]))
                continue
            try:
                decode_own_hand(message)
            except FrameError:
                self.counts["malformed own hand"] += 1
                continue
            if self._tab is not None:
                self._tab.show(message)
