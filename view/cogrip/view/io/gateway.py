"""Gateway: pages and hands for many people who have only a browser, each an ordinary client of the server by its own token.

Nothing here knows what a token allows. It is checked by acting on it: whoever observes does so by an observer's session of
that token, whoever holds the object by a player's process of that token; what the server refuses, the gateway refuses.
"""

import asyncio
import re
import ssl
import time
from collections import Counter
from collections.abc import Callable, Collection, Coroutine
from dataclasses import dataclass, field
from hashlib import sha256

from cogrip.client.io.paths import JoinError
from cogrip.machine.stop import Stop
from cogrip.protocol.wire.join_link import is_token
from cogrip.view import access, page
from cogrip.view.access import FRONT_ENDS, Access
from cogrip.view.io.feed import LiveFeed
from cogrip.view.io.foxglove_socket import speak
from cogrip.view.io.hand_process import HandProcess
from cogrip.view.io.page_server import Admitted, DeniedError, PageServer
from cogrip.view.io.process import LOOKED_AGAIN_S, PortError, port_taken

MOST_SESSIONS = 64  # most observers of the server at once, one for each token
SEAT_S = 30.0  # time in which a hand has to get its seat
REFUSED = "the server refused: "
WRONG_TOKEN = "[token]"
_AROUND = re.compile(rf"^{REFUSED}| \[\w+\]| \(server \S+\)$")


@dataclass(slots=True, eq=False)
class _Shared:
    """Session of one token, for all of its tabs."""

    opened: "asyncio.Task[LiveFeed]"
    over: "asyncio.Future[DeniedError]"
    tabs: int = 0


@dataclass(slots=True)
class Gateway:
    """Serves until `stop`, the end of its own session, or `seconds`.

    own       connected session of the gateway's own link: what those who have a hand are shown
    observe   makes a session that observes by a token, not yet connected
    new_hand  makes a player's process, not yet started
    link_of   gives the join link of a token
    hosts     HOST:PORT texts by which people reach the gateway, given the port
    origins   whole origins by which people reach it through a proxy
    proxies   addresses of proxies that are trusted to say for whom they ask
    """

    own: LiveFeed
    own_token: str = field(repr=False)
    observe: Callable[[str], LiveFeed]
    new_hand: Callable[[], HandProcess]
    link_of: Callable[[str], str]
    hosts: Callable[[int], list[str]]
    stop: Stop
    ready: Callable[[int], None]  # called with the port
    host: str
    port: int
    tls: ssl.SSLContext | None
    most_hands: int
    foxglove: bool = False
    front_ends: tuple[str, ...] = FRONT_ENDS
    seconds: float | None = None
    origins: Collection[str] = ()
    proxies: Collection[str] = ()
    counts: Counter[str] = field(init=False, default_factory=Counter)
    _shared: dict[bytes, _Shared] = field(init=False, default_factory=dict)
    _hands: set[HandProcess] = field(init=False, default_factory=set)
    _endings: dict[asyncio.Task[None], bytes] = field(init=False, default_factory=dict)
    _server: PageServer = field(init=False)

    def run(self) -> str:
        """Return why the gateway ended before its time, "" where it was stopped. Raises PortError."""
        return asyncio.run(self._run())

    async def _run(self) -> str:
        policy = page.content_security_policy()
        speaks = speak if self.foxglove else None
        server = self._server = PageServer(
            Access([]), page.served_files(), policy, self._admit, self._leave, foxglove=speaks, proxies=self.proxies
        )
        try:
            await server.listen(self.host, self.port, self.tls)
        except OSError as error:
            raise PortError(port_taken(self.port, error)) from None
        scheme, front_ends = "http" if self.tls is None else "https", self.front_ends if self.foxglove else ()
        server.access = Access(self.hosts(server.port), scheme, public=self.origins, front_ends=front_ends)
        self.own.start()
        self._keep(_key(self.own_token), self.own)
        self.ready(server.port)
        try:
            return await self._wait()
        finally:
            await server.close()
            for shared in list(self._shared.values()):
                self._finish(shared)
            for hand in list(self._hands):
                self._end_hand(hand, b"")
            await asyncio.gather(*self._endings)
            self.counts.update(server.access.refused + server.counts)

    async def _wait(self) -> str:
        loop = asyncio.get_running_loop()
        end_s = None if self.seconds is None else loop.time() + self.seconds
        while not self.stop.reason and (end_s is None or loop.time() < end_s):
            if self.own.ended:
                return self.own.ended
            for key, shared in list(self._shared.items()):
                if shared.opened.done() and not shared.opened.exception() and (ended := shared.opened.result().ended):
                    del self._shared[key]  # whoever comes next has to show that the token is still good
                    shared.over.set_result(DeniedError(_plain(ended), access.TOKEN, "session over"))
            await asyncio.sleep(LOOKED_AGAIN_S)
        return ""

    # Observers -------------------------------------------------------------------------------------------------------

    async def _admit(self, token: str, hand: bool, address: object) -> Admitted:
        key, visitors = _key(token), self._server.visitors
        if key not in self._shared and not visitors.may_try(address, time.monotonic_ns()):
            raise DeniedError("too many wrong tokens came from there: wait a minute", access.TOKEN, "token budget")
        if not is_token(token):
            visitors.failed(address, time.monotonic_ns())
            raise DeniedError("this address has no token: open the link as you got it, with all that follows the #")
        try:
            return await (self._hold(token, key) if hand else self._look(token, key))
        except DeniedError as denied:
            if denied.reason == "token":
                visitors.failed(address, time.monotonic_ns())
            raise

    async def _look(self, token: str, key: bytes) -> Admitted:
        shared = self._shared.get(key)
        if shared is None:
            if len(self._shared) >= MOST_SESSIONS:
                words = f"all {MOST_SESSIONS} sessions of this gateway are taken: come again later"
                raise DeniedError(words, access.NO_RIGHT, "too many sessions")
            shared = self._keep(key, self.observe(token))
        shared.tabs += 1
        try:
            return Admitted(await asyncio.shield(shared.opened), over=shared.over, held=shared)
        except JoinError as error:
            self._release(shared)
            refused = str(error).startswith(REFUSED)
            raise DeniedError(_plain(str(error)), access.TOKEN, "token" if refused else "no server") from None
        except asyncio.CancelledError:
            self._release(shared)
            raise

    def _keep(self, key: bytes, feed: LiveFeed) -> _Shared:
        over = asyncio.get_running_loop().create_future()
        opened = asyncio.create_task(_opened(feed) if feed is not self.own else _as_it_is(feed))
        shared = self._shared[key] = _Shared(opened, over, tabs=int(feed is self.own))
        return shared

    def _release(self, shared: _Shared) -> None:
        shared.tabs -= 1
        if not shared.tabs:
            self._finish(shared)

    def _finish(self, shared: _Shared) -> None:
        """End a session that nobody looks at any more."""
        for key in [key for key, each in self._shared.items() if each is shared]:
            del self._shared[key]

        async def close() -> None:
            try:
                feed = await shared.opened
            except JoinError:
                return
            await asyncio.to_thread(feed.close)

        self._later(close(), b"")

    # Whoever holds ---------------------------------------------------------------------------------------------------

    async def _hold(self, token: str, key: bytes) -> Admitted:
        """Start a player's process. Its seat is the proof of the token, and the gateway's own session its picture."""
        if earlier := [task for task, of in self._endings.items() if of == key]:
            await asyncio.wait(earlier)  # a page that is loaded again: its seat is free in a moment
        if len(self._hands) >= self.most_hands:
            words = f"all {self.most_hands} hands of this gateway are taken: observe (leave &hand out), or come again"
            raise DeniedError(words, access.NO_RIGHT, "too many hands")
        hand = self.new_hand()
        self._hands.add(hand)
        try:
            async with asyncio.timeout(SEAT_S):
                seated = await hand.start(self.link_of(token))
        except TimeoutError:
            self._end_hand(hand, key)
            raise DeniedError(f"no seat within {SEAT_S:g} s", access.NO_RIGHT, "hand refused") from None
        except asyncio.CancelledError:
            self._end_hand(hand, key)
            raise
        over = asyncio.get_running_loop().create_future()
        if not seated:
            self._end_hand(hand, key)
            words = await hand.ended
            if WRONG_TOKEN in words:
                raise DeniedError(_plain(words))
            raise DeniedError(_plain(words), access.NO_RIGHT, "hand refused")

        def end(ended: "asyncio.Future[str]") -> None:
            over.set_result(DeniedError(_plain(ended.result()), access.NO_RIGHT, "hand ended"))

        hand.ended.add_done_callback(end)
        return Admitted(self.own, hand.link, over, held=(hand, key))

    def _end_hand(self, hand: HandProcess, key: bytes) -> None:
        self._hands.discard(hand)
        self._later(hand.close(), key)

    def _leave(self, admitted: Admitted) -> None:
        if isinstance(admitted.held, _Shared):
            self._release(admitted.held)
        elif isinstance(admitted.held, tuple):
            self._end_hand(*admitted.held)

    def _later(self, work: Coroutine[None, None, None], key: bytes) -> None:
        task = asyncio.create_task(work)
        self._endings[task] = key
        task.add_done_callback(lambda done: self._endings.pop(done, None))


async def _opened(feed: LiveFeed) -> LiveFeed:
    """Return a feed once it has an observer's place. Raises JoinError."""
    try:
        await asyncio.to_thread(feed.connect)
    except JoinError:
        feed.paths.close()
        raise
    feed.start()
    return feed


async def _as_it_is(feed: LiveFeed) -> LiveFeed:
    return feed


def _key(token: str) -> bytes:
    return sha256(token.encode("utf-8", "surrogatepass")).digest()


def _plain(text: str) -> str:
    """Return a client's reason without what only its own user could do something about."""
    return _AROUND.sub("", text)
