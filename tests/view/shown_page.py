"""A page server in this process with a feed that a test moves, and a client that writes every byte itself."""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from cogrip.view.access import Access
from cogrip.view.frames import SceneFrame, encode
from cogrip.view.io.feed import ChunkError
from cogrip.view.io.page_server import Admitted, DeniedError, PageServer
from cogrip.view.page import ServedFile
from cogrip.view.scene import DrawnObject, PageScene
from cogrip.view.tab import Tab
from cogrip.view.visitors import VisitorLimits, Visitors

TOKEN = "t0ken"
HELLO = f'{{"type":"hello","token":"{TOKEN}"}}'
LIMIT_S = 20.0  # for what is waited for
TEXT, BINARY, CLOSE = 1, 2, 8


@dataclass(eq=False)
class ShownFeed:
    """A feed of one object that nobody holds."""

    scene: PageScene = field(
        default_factory=lambda: PageScene("demo", "live", 3, 128, 1024, DrawnObject("mass", "box", (0.04,) * 3, 0.5))
    )
    tabs: dict[Tab, bool] = field(default_factory=dict)
    frame: SceneFrame | None = None
    ended: str = ""

    def chunk(self, number: int) -> bytes:
        raise ChunkError(number)

    def show(self, number: int) -> None:
        """Show all tabs the frame of a step."""
        frame = SceneFrame(3, number, number / 128, (1e-3 * number, 0.0, 0.0), (0.0,) * 3, ())
        for tab in self.tabs:
            tab.show(encode(frame))


@dataclass
class Shown:
    """A page server that runs. entered, left: those who were let in, and those who have gone."""

    feed: ShownFeed = field(default_factory=ShownFeed)
    server: PageServer = field(init=False)
    entered: int = 0
    left: int = 0

    @property
    def refused(self) -> dict[str, int]:
        return {name: count for name, count in self.server.access.refused.items() if count}

    async def admit(self, token: str, hand: bool, address: object) -> Admitted:
        if token != TOKEN:
            raise DeniedError("no such token")
        self.entered += 1
        return Admitted(self.feed)

    def leave(self, admitted: Admitted) -> None:
        self.left += 1

    async def until_refused(self, count: int) -> dict[str, int]:
        """Return the refusals once there are so many."""
        await until(lambda: sum(self.refused.values()) >= count)
        return self.refused

    async def until_nobody(self) -> None:
        await until(lambda: not self.server.visitors.tabs)


async def until(true: Callable[[], bool]) -> None:
    """Let the server go on until something is true."""
    async with asyncio.timeout(LIMIT_S):
        while not true():  # noqa: ASYNC110 (it is no event of ours)
            await asyncio.sleep(0)


@asynccontextmanager
async def shown_page(limits: VisitorLimits | None = None) -> AsyncIterator[Shown]:
    """Serve a page until the context is left."""
    shown = Shown()
    server = shown.server = PageServer(
        Access([]), {"/": ServedFile("text/html; charset=utf-8", b"<title>page</title>")}, "default-src 'none'", shown.admit,
        shown.leave,
    )  # fmt: skip
    if limits is not None:
        server.visitors = Visitors(limits, 1)
    await server.listen("127.0.0.1", 0)
    server.access = Access([f"127.0.0.1:{server.port}"], allowed=["https://front.example"])
    try:
        yield shown
    finally:
        await server.close()


class RawClient:
    """One connection. `ask` sends a request, `send` a frame of the websocket, `closed` waits for the end."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @classmethod
    async def connect(cls, port: int) -> "RawClient":
        return cls(*await asyncio.open_connection("127.0.0.1", port))

    @classmethod
    async def upgraded(cls, port: int) -> "RawClient":
        """Return a client whose websocket is open."""
        client = await cls.connect(port)
        assert (await client.ask(upgrade(port))).startswith(b"HTTP/1.1 101")
        return client

    async def ask(self, request: bytes) -> bytes:
        """Send a request, and return the head of the answer; b"" where the connection was closed instead."""
        self.write(request)
        try:
            async with asyncio.timeout(LIMIT_S):
                return await self._reader.readuntil(b"\r\n\r\n")
        except (asyncio.IncompleteReadError, ConnectionError):
            return b""

    def write(self, data: bytes) -> None:
        self._writer.write(data)

    def send(self, payload: bytes, opcode: int = TEXT) -> None:
        self.write(frame_bytes(payload, opcode))

    async def read(self) -> tuple[int, bytes]:
        """Return opcode and payload of the next frame."""
        first, length = await self._reader.readexactly(2)
        if length == 126:
            (length,) = struct.unpack("!H", await self._reader.readexactly(2))
        elif length == 127:
            (length,) = struct.unpack("!Q", await self._reader.readexactly(8))
        return first & 15, await self._reader.readexactly(length)

    async def closed(self) -> int:
        """Return the code with which the server closes; 0 where it says none."""
        code = 0
        try:
            async with asyncio.timeout(LIMIT_S):
                while True:
                    opcode, payload = await self.read()
                    if opcode == CLOSE:
                        code = struct.unpack("!H", payload[:2])[0] if payload else 0
                        self.send(payload[:2], CLOSE)
        except (asyncio.IncompleteReadError, ConnectionError):
            self._writer.close()
            return code

    def abort(self) -> None:
        self._writer.transport.abort()


def upgrade(port: int, *lines: str, path: str = "/socket", host: str | None = None) -> bytes:
    """Return the request that opens a websocket. lines: further headers."""
    headers = [
        f"GET {path} HTTP/1.1", f"Host: {f'127.0.0.1:{port}' if host is None else host}", "Upgrade: websocket",
        "Connection: Upgrade", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Protocol: cogrip.view.v1", *lines,
    ]  # fmt: skip
    return "\r\n".join([*headers, "", ""]).encode()


def frame_bytes(payload: bytes, opcode: int, first: int = 0x80, *, masked: bool = True) -> bytes:
    """Return a client's frame. first: its bits beside the opcode."""
    size, bit = len(payload), 0x80 if masked else 0
    if size < 126:
        head = struct.pack("!BB", first | opcode, bit | size)
    elif size < 65536:
        head = struct.pack("!BBH", first | opcode, bit | 126, size)
    else:
        head = struct.pack("!BBQ", first | opcode, bit | 127, size)
    return head + (b"\0\0\0\0" if masked else b"") + payload
