"""A websocket server around `FoxgloveSession`, for tests; a recording plays by the event loop's clock."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import cast

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from cogrip.view.foxglove import SUBPROTOCOLS, FoxgloveError, FoxgloveSession


@asynccontextmanager
async def serving(make: Callable[[], FoxgloveSession]) -> AsyncIterator[str]:
    """Serve sessions, one for each client; yields the address."""

    async def attend(socket: ServerConnection) -> None:
        session, now_s = make(), asyncio.get_running_loop().time
        for message in session.opening(now_s()):
            await socket.send(message)
        try:
            while True:
                next_s = session.next_s(now_s())
                try:
                    async with asyncio.timeout_at(next_s):
                        answers = session.receive(await socket.recv(), now_s())
                except TimeoutError:
                    answers = session.due(now_s())
                except FoxgloveError as error:
                    await socket.close(1002, str(error)[:100])
                    return
                for message in answers:
                    await socket.send(message)
        except ConnectionClosed:
            return

    subprotocols = [Subprotocol(each) for each in SUBPROTOCOLS]
    async with serve(attend, "127.0.0.1", 0, subprotocols=subprotocols) as server:
        host, port = cast(tuple[str, int], next(iter(server.sockets)).getsockname())
        yield f"ws://{host}:{port}/foxglove"
