"""The view's process: one feed, one port, until it is stopped."""

import asyncio
import os
import secrets
import webbrowser
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import ip_address

from cogrip.machine.stop import Stop
from cogrip.view import page
from cogrip.view.access import FRONT_ENDS, Access, same
from cogrip.view.io import platform
from cogrip.view.io.feed import Feed, LiveFeed
from cogrip.view.io.foxglove_socket import speak
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.page_server import Admitted, DeniedError, PageServer

LOOKED_AGAIN_S = 0.1  # time between two looks at the stop flag
LOOPBACK = "127.0.0.1"


class ListeningError(Exception):
    """The port cannot be had. The text says why and what to do."""


@dataclass(slots=True)
class ViewProcess:
    """Page of one feed on loopback. `run` blocks until `stop`, the session's end, or `seconds`.

    opens      open the browser
    allowed    further origins whose front ends may connect
    front_ends origins whose pages may connect for Foxglove's protocol, where it is offered (`Access`)
    hand       link to the client whose device the page moves, None without one
    """

    feed: Feed
    stop: Stop
    say: Callable[[str], None]
    port: int = 0
    opens: bool = True
    foxglove: bool = False
    allowed: tuple[str, ...] = ()
    front_ends: tuple[str, ...] = FRONT_ENDS
    hand: HandLink | None = None
    seconds: float | None = None
    counts: Counter[str] = field(init=False, default_factory=Counter)
    token: str = field(init=False, default_factory=lambda: secrets.token_urlsafe(16), repr=False)

    def run(self) -> str:
        """Return why the session ended before its time, "" where it was stopped. Raises ListeningError."""
        return platform.run(self._run())

    async def _run(self) -> str:
        hosts: list[str] = []
        server = PageServer(
            Access(hosts),
            page.served_files(),
            page.content_security_policy(),
            self._admit,
            foxglove=speak if self.foxglove else None,
        )
        try:
            await server.listen(LOOPBACK, self.port)
        except OSError as error:
            raise ListeningError(address_taken(self.port, error)) from None
        here = f"{LOOPBACK}:{server.port}"
        front_ends = self.front_ends if self.foxglove else ()
        server.access = Access([here, f"localhost:{server.port}"], allowed=self.allowed, front_ends=front_ends)
        if isinstance(self.feed, LiveFeed):
            self.feed.start()
        if self.hand is not None:
            self.hand.start()
        self._announce(server, here)
        try:
            return await self._wait()
        finally:
            if self.hand is not None:
                self.counts.update(self.hand.counts)
                self.hand.close()
            ended = self.feed.ended or (self.hand.ended if self.hand is not None else "")
            await server.close(
                f"The session is over: {ended}" if ended else "The command that served this page has ended"
            )
            if isinstance(self.feed, LiveFeed):
                self.feed.close()
            self.counts.update(server.access.refused + server.counts)

    def _announce(self, server: PageServer, here: str) -> None:
        fragment = f"/#{self.token}{'&hand' if self.hand else ''}"
        url = f"http://{here}{fragment}"
        self.say(f"view: {url}")
        if self.foxglove:
            self.say(f"Foxglove, Lichtblick: ws://{here}/foxglove?token={self.token}")
        if self.opens and not open_browser(f"http://{here}{server.open_once(fragment)}"):
            self.say("no browser could be opened here: open this address in one yourself")

    async def _wait(self) -> str:
        loop = asyncio.get_running_loop()
        end_s = None if self.seconds is None else loop.time() + self.seconds
        while not self.stop.reason and (end_s is None or loop.time() < end_s):
            if self.feed.ended:
                return self.feed.ended
            if self.hand is not None and self.hand.ended:
                return self.hand.ended
            await asyncio.sleep(LOOKED_AGAIN_S)
        return ""

    async def _admit(self, token: str, hand: bool, address: object) -> Admitted:
        if not same(token, self.token):
            raise DeniedError("this address is of another view: open the one that was printed last")
        return Admitted(self.feed, self.hand if hand else None)


def address_taken(port: int, error: OSError) -> str:
    """Return why a port cannot be had, and what to do."""
    reason = os.strerror(error.errno) if error.errno else str(error)
    return f"port {port}: {reason}; give another one with --port, or leave it out for a free one"


def open_browser(url: str) -> bool:
    """Open a page in the user's graphical browser; False where there is none."""
    if not platform.has_display():
        return False
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False


def is_loopback(host: str) -> bool:
    """Return whether an address stays on this machine."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
