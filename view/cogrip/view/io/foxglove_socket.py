"""Foxglove's protocol over a websocket: moves messages between a connection and `FoxgloveSession`."""

import asyncio
import time

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from cogrip.view.foxglove import FoxgloveError, FoxgloveSession
from cogrip.view.io.feed import Feed, RecordedFeed
from cogrip.view.playback import Playback
from cogrip.view.tab import Tab

IDLE_S = 1.0
CLOSED_BY_PROTOCOL = 1002


async def speak(connection: ServerConnection, feed: Feed) -> None:
    """Show a feed to a client of Foxglove's protocol until either end closes."""
    began_ns, playback = time.time_ns(), None
    if isinstance(feed, RecordedFeed):
        recorded = feed.recorded
        began_ns = recorded.began_ns
        playback = Playback(recorded.frames, feed.scene.chunks, feed.scene.duration_s or 0.0)
        playback.play(time.monotonic())
    elif feed.frame is not None:
        began_ns -= round(feed.frame.time_s * 1e9)
    session = FoxgloveSession(feed.scene, began_ns, playback)
    woken = asyncio.Event()
    tab = Tab(woken.set)
    feed.tabs[tab] = False
    for message in session.opening(time.monotonic()):
        await connection.send(message)
    writer = asyncio.create_task(_write(connection, feed, session, playback, tab, woken))
    try:
        async for message in connection:
            for answer in session.receive(message, time.monotonic()):
                await connection.send(answer)
            woken.set()  # what was asked for may be due now
    except FoxgloveError as error:
        await connection.close(CLOSED_BY_PROTOCOL, str(error)[:100])
    finally:
        writer.cancel()
        del feed.tabs[tab]


async def _write(
    connection: ServerConnection,
    feed: Feed,
    session: FoxgloveSession,
    playback: Playback | None,
    tab: Tab,
    woken: asyncio.Event,
) -> None:
    """Send frames as they come, those of a recording as they are due; a slow client gets the newest."""
    scene = feed.scene
    try:
        while True:
            now_s = time.monotonic()
            next_s = session.next_s(now_s)
            try:
                async with asyncio.timeout(IDLE_S if next_s is None else max(0.0, next_s - now_s)):
                    await woken.wait()
            except TimeoutError:
                pass
            woken.clear()
            if feed.scene is not scene:
                scene = feed.scene
                for message in session.change(scene):
                    await connection.send(message)
            if playback is not None and isinstance(feed, RecordedFeed):  # read what will be played before it is due
                for number in playback.wanted(time.monotonic()):
                    await asyncio.to_thread(feed.recorded.frames, number)
            due = session.due(time.monotonic())
            if tab.take() and feed.frame is not None:
                due += session.messages(feed.frame)
            for message in due:
                await connection.send(message)
    except ConnectionClosed:
        pass
