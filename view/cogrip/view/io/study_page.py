"""Page of a study: a panel for each participant, and the session that goes on, if one does (`docs/view.md`).

It outlasts sessions, in a thread of its own: tabs stay open from the first trial to the last.
"""

import asyncio
import secrets
import socket
import threading
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial

from cogrip.machine.addition import add_integers
from cogrip.machine.platform import system
from cogrip.view import page
from cogrip.view.access import Access, same
from cogrip.view.frames import SceneFrame
from cogrip.view.io import platform
from cogrip.view.io.feed import ChunkError, LiveFeed, scene_text
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.page_server import Admitted, DeniedError, PageServer
from cogrip.view.io.process import LOOPBACK, ListeningError, address_taken
from cogrip.view.panel import Panel, PanelMessage
from cogrip.view.scene import DrawnObject, PageScene
from cogrip.view.tab import Tab

MOST_REPLY_BYTES = 64 * 1024  # most bytes of a reply: 10,000 letters, each of which JSON may write in six bytes
END_S = 5.0
NUMBER_BITS = 30  # bits of the random number that prompts are counted from: below `MOST_NUMBER` there are as many again


@dataclass(eq=False)
class StudyFeed:
    """Feed of one session after the other, for the same tabs; between two the last one stands still."""

    idle: PageScene
    tabs: dict[Tab, bool] = field(init=False, default_factory=dict)
    ended: str = field(init=False, default="")
    live: LiveFeed | None = field(init=False, default=None)

    @property
    def scene(self) -> PageScene:
        return self.idle if self.live is None else self.live.scene

    @property
    def frame(self) -> SceneFrame | None:
        return None if self.live is None else self.live.frame

    def chunk(self, number: int) -> bytes:
        raise ChunkError(number)

    def follow(self, live: LiveFeed) -> None:
        """Show a session that is connected; in the event loop's thread."""
        live.tabs, self.live = self.tabs, live
        live.start()
        self.tell_scene()

    def tell_scene(self) -> None:
        """Tell all tabs the scene again."""
        for tab, hand in self.tabs.items():
            tab.say(scene_text(self, tab, hand=hand))


class StudyPage:
    """Page of the people who have `tokens`, on `port` of loopback where that is free.

    hands: those whose device is the page's pointer; counts: refusals by name, once it is closed.
    """

    def __init__(self, name: str, tokens: Mapping[str, str], hands: Collection[str] = (), port: int = 0) -> None:
        self.counts: Counter[str] = Counter()
        self.port = port
        self.tokens = dict(tokens)
        self._feed = StudyFeed(PageScene(name, "live", 3, 128, 1024, DrawnObject("mass", "box", (0.04,) * 3, 1.0)))
        number = secrets.randbits(NUMBER_BITS)
        self._panels = {person: Panel(person, partial(self._post, self._tell, person), number) for person in tokens}
        pairs = {person: system.datagram_pair() for person in hands}
        self._ends: dict[str, socket.socket] = {person: theirs for person, (_, theirs) in pairs.items()}
        self._hands = {person: HandLink(ours, self._feed.tell_scene) for person, (ours, _) in pairs.items()}
        self._shown: LiveFeed | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ready = threading.Event()
        self._failed: OSError | None = None
        self._stop: asyncio.Event
        self._thread = threading.Thread(target=lambda: platform.run(self._run()), name="page", daemon=True)

    def start(self) -> None:
        """Begin to serve. Raises ListeningError where no port is to be had."""
        self._thread.start()
        self._ready.wait()
        if self._failed is not None:
            raise ListeningError(address_taken(self.port, self._failed))

    def close(self) -> None:
        """End the page, within some seconds."""
        self.rest()
        self._post(lambda: self._stop.set())
        self._thread.join(END_S)
        for end in self._ends.values():
            end.close()

    def __enter__(self) -> "StudyPage":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def address(self, person: str) -> str:
        """Return the address of a person's page."""
        return f"http://{LOOPBACK}:{self.port}/#{self.tokens[person]}{'&hand' if person in self._hands else ''}"

    # The study's side ------------------------------------------------------------------------------------------------

    def panel(self, person: str) -> Panel:
        """Return a person's panel."""
        return self._panels[person]

    def show(self, people: Sequence[str], message: Callable[[str], PanelMessage]) -> None:
        """Show each of these people a panel."""
        for person in people:
            self._panels[person].show(message(person))

    def hand(self, person: str) -> int | None:
        """Return the descriptor of the link to a person's pointer, for their next client; None for another device."""
        end = self._ends.get(person)
        if end is None:
            return None
        end.setblocking(False)
        with suppress(OSError):
            while end.recv(4096):  # what the pointer said while no client was there
                pass
        return end.fileno()

    def follow(self, live: LiveFeed) -> None:
        """Show a session to which this feed has been connected."""
        begun = threading.Event()

        def begin() -> None:
            self._feed.follow(live)
            begun.set()

        self._post(begin)
        begun.wait(END_S)
        self._shown = live

    def rest(self) -> None:
        """Follow the session no more; its last picture stays."""
        if self._shown is not None:
            self._shown.close("the session is over")
            self._shown = None

    # The page's thread -----------------------------------------------------------------------------------------------

    def _post(self, call: Callable[..., None], *arguments: object) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # it has been closed
                self._loop.call_soon_threadsafe(call, *arguments)

    def _tell(self, person: str) -> None:
        self._panels[person].tell()

    async def _run(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        server = PageServer(
            Access([]), page.served_files(), page.content_security_policy(), self._admit, most_bytes=MOST_REPLY_BYTES
        )
        try:
            await self._listen(server)
        except OSError as error:
            self._failed = error
            return
        finally:
            self._ready.set()
        for hand in self._hands.values():
            hand.start()
        await self._stop.wait()
        for hand in self._hands.values():
            hand.close()
        await server.close()
        late = add_integers(panel.late for panel in self._panels.values())
        self.counts.update(server.access.refused + server.counts + Counter({"late reply": late}))

    async def _listen(self, server: PageServer) -> None:
        """Listen on the port of last time, or on another one where that is taken. Raises OSError."""
        try:
            await server.listen(LOOPBACK, self.port)
        except OSError:
            await server.listen(LOOPBACK, 0)
        self.port = server.port
        server.access = Access([f"{LOOPBACK}:{server.port}", f"localhost:{server.port}"])

    async def _admit(self, token: str, hand: bool, address: object) -> Admitted:
        person = next((person for person, theirs in self.tokens.items() if same(token, theirs)), None)
        if person is None:
            raise DeniedError("this address is of another study: open the one that was printed for you")
        return Admitted(self._feed, self._hands.get(person) if hand else None, panel=self._panels[person])


def new_token() -> str:
    """Return a token for a person's page."""
    return secrets.token_urlsafe(16)
