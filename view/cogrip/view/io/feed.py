"""Feeds: what the tabs of a page are shown, a live session or a recording."""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from msgspec.structs import replace

from cogrip.client.io.paths import JoinError, Paths
from cogrip.client.observer import ObserverCore
from cogrip.client.observer_loop import LiveObserver
from cogrip.machine.stop import Stop
from cogrip.protocol.wire.session import ClientSession
from cogrip.view import frames
from cogrip.view.frames import Frame
from cogrip.view.live import LiveScene
from cogrip.view.recording import RecordedView
from cogrip.view.scene import Scene, SceneEvent, to_json
from cogrip.view.tab import Tab


class ChunkError(KeyError):
    """There is no such chunk."""


class Feed(Protocol):
    """A scene that `tabs` are shown. ended: why it is over, "" while it goes on."""

    tabs: dict[Tab, bool]  # True: it moves the hand
    ended: str

    @property
    def frame(self) -> Frame | None:
        """Newest frame."""

    @property
    def scene(self) -> Scene:
        """Scene as it is now."""

    def chunk(self, number: int) -> bytes:
        """Return a chunk of a recording. Raises ChunkError."""


def scene_text(feed: Feed, tab: Tab, *, hand: bool) -> str:
    """Return the scene as a tab is told it."""
    scene = feed.scene
    return to_json(replace(scene, hand=hand, own_seat=tab.own_seat if hand else None, note=tab.note or scene.note))


@dataclass(slots=True, eq=False)
class RecordedFeed:
    """A recording; each tab plays it for itself."""

    recorded: RecordedView
    tabs: dict[Tab, bool] = field(init=False, default_factory=dict)
    frame: Frame | None = field(init=False, default=None)
    ended: str = field(init=False, default="")

    @property
    def scene(self) -> Scene:
        """Scene of the recording."""
        return self.recorded.scene

    def chunk(self, number: int) -> bytes:
        """Return a chunk. Raises ChunkError."""
        if number >= self.scene.chunks:
            raise ChunkError(number)
        return self.recorded.chunk(number)


@dataclass(slots=True, eq=False)
class LiveFeed:
    """A session as one observer sees it. `start` begins a thread, which `close` ends."""

    hello_session: ClientSession
    paths: Paths
    say: Callable[[str], None]
    scene: Scene = field(init=False)
    tabs: dict[Tab, bool] = field(init=False, default_factory=dict)
    frame: Frame | None = field(init=False, default=None)
    ended: str = field(init=False, default="")
    core: ObserverCore = field(init=False)
    _stop: Stop = field(init=False, default_factory=Stop)
    _live: LiveScene = field(init=False)
    _thread: threading.Thread = field(init=False)
    _views: int = field(init=False, default=0)
    _loop: asyncio.AbstractEventLoop = field(init=False)

    def connect(self) -> None:
        """Take an observer's place. Raises JoinError, after at most some seconds."""
        self.core = ObserverCore(self.hello_session)
        self.paths.connect(self.core, self._stop)
        welcome = self.hello_session.welcome
        assert welcome is not None
        self._live = LiveScene(welcome.settings)
        self.scene = self._live.scene

    def tell_hands(self) -> None:
        """Tell tabs with a hand the scene again: its seat is known now."""
        for tab, hand in self.tabs.items():
            if hand:
                tab.say(scene_text(self, tab, hand=True))

    def start(self) -> None:
        """Begin to follow the session; called in the event loop's thread."""
        self._loop = asyncio.get_running_loop()
        self._thread = threading.Thread(target=self._run, name="observer", daemon=True)
        self._thread.start()

    def close(self, reason: str = "the view is closed") -> None:
        """Leave the session, within a second."""
        self._stop.reason = self._stop.reason or reason
        self._thread.join(timeout=2.0)
        self.paths.close()

    def chunk(self, number: int) -> bytes:
        raise ChunkError(number)

    def _run(self) -> None:
        observer = LiveObserver(self.core, self.paths, self._stop, self.say, self._show)
        try:
            failed = observer.run()
        except JoinError as error:
            failed = str(error)
        self._post(lambda: self._end(failed or self.core.session.ended or "the view is closed"))

    def _show(self, core: ObserverCore, now_ns: int) -> None:
        """Make a frame of a view that is new, in the observer's thread."""
        if core.views == self._views:
            return
        self._views = core.views
        frame = self._live.update(core)
        if frame is not None:
            events = list(self._live.events)
            self._live.events.clear()
            scene, message = self._live.scene, frames.encode(frame)
            self._post(lambda: self._publish(scene, events, frame, message))

    def _post(self, call: Callable[[], None]) -> None:
        try:
            self._loop.call_soon_threadsafe(call)
        except RuntimeError:  # the loop has been closed: nobody looks any more
            self._stop.reason = "the view is closed"

    def _publish(self, scene: Scene, events: list[SceneEvent], frame: Frame, message: bytes) -> None:
        changed = scene is not self.scene
        self.scene, self.frame = scene, frame
        for tab, hand in self.tabs.items():
            if changed:
                tab.say(scene_text(self, tab, hand=hand))
            for event in events:
                tab.say(to_json(event))
            tab.show(message)

    def _end(self, reason: str) -> None:
        self.ended = reason
        now_s = self.frame.time_s if self.frame else 0.0
        for tab in self.tabs:
            tab.say(to_json(SceneEvent(now_s, "other", "", f"the session is over: {reason}")))
