"""Tabs without a browser: clients of a page's socket that count the frames they get. `python tabs.py URL COUNT`

Prints `reading` once all have a frame, and on a line of standard input the frames a second of each since then, as JSON.
"""

import asyncio
import json
import sys
import time

from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol

OURS = Subprotocol("cogrip.view.v1")
FRAME = 1


def socket_of(url: str) -> tuple[str, str]:
    """Return the socket's address and the token of a page's address."""
    place, _, fragment = url.partition("#")
    token = fragment.removesuffix("&hand")
    return f"{place.replace('http', 'ws', 1)}socket", token


async def opened(url: str, *, hand: bool = False) -> ClientConnection:
    """Return a socket that has said hello."""
    address, token = socket_of(url)
    tab = await connect(address, subprotocols=[OURS], compression=None)
    await tab.send(json.dumps({"type": "hello", "token": token, "hand": hand}))
    return tab


async def read_all(url: str, count: int) -> list[float]:
    """Return the frames a second of each tab."""
    counts = [0] * count

    async def read(number: int, tab: ClientConnection) -> None:
        async for message in tab:
            if isinstance(message, bytes) and message[0] == FRAME:
                counts[number] += 1

    tasks = [asyncio.create_task(read(number, await opened(url))) for number in range(count)]
    while not all(counts):  # noqa: ASYNC110 (a load waits for the network)
        await asyncio.sleep(0.05)
    begun_s, before = time.monotonic(), list(counts)
    print("reading", flush=True)
    await asyncio.to_thread(sys.stdin.readline)
    took_s = time.monotonic() - begun_s
    for task in tasks:
        task.cancel()
    return [(now - then) / took_s for now, then in zip(counts, before, strict=True)]


if __name__ == "__main__":
    print(json.dumps(asyncio.run(read_all(sys.argv[1], int(sys.argv[2])))))
