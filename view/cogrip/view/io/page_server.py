"""HTTP server and websocket of the view, on one port: page files to browsers, frames to tabs, pointer messages to a hand."""

import asyncio
import logging
import secrets
import ssl
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from ipaddress import ip_address
from typing import Any, cast
from urllib.parse import parse_qs

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, ProtocolError
from websockets.frames import CTRL_OPCODES, Frame
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from cogrip.devices.web.messages import FrameError, Pointer, decode_pointer
from cogrip.view import access, frames
from cogrip.view.access import Access
from cogrip.view.hello import ChunkRequest, PageError, PageHello, PanelReply, read_text
from cogrip.view.io.feed import ChunkError, Feed, scene_text
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.peer_log import PeerLog, bound_log
from cogrip.view.page import ServedFile
from cogrip.view.panel import Panel
from cogrip.view.tab import Tab
from cogrip.view.visitors import VisitorLimits, Visitors

OURS = Subprotocol("cogrip.view.v1")
FOXGLOVE = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
WRITE_BYTES = 64 * 1024  # most bytes that wait for a slow client, beside what the system buffers
MOST_BYTES = access.MOST_MESSAGE_BYTES
RESERVE_BYTES = access.MOST_MESSAGE_BYTES
"""Bytes that are read beyond the largest message: what is larger still is not even read."""
TLS_S = 5.0
MOST_CONTROL_FRAMES = 16  # most control frames of a connection before its token is admitted: each ping is answered
PROTOCOL_ERRORS = {1002: "malformed websocket frame", 1007: "text that is not UTF-8", 1009: "message too large"}

HAND_ELSEWHERE = "Another tab of this address holds your device. It comes to this one when that one is closed."

Refusal = tuple[int, str, str]  # close code, reason under which it is counted, words ("": the reason)


@dataclass(frozen=True, slots=True)
class Admitted:
    """Answer to a token: what its holder is shown, and may move.

    hand   None for an observer
    over   its result ends the tab
    held   whatever whoever admitted it needs when it is handed back
    panel  of a study's participant, None elsewhere
    """

    feed: Feed
    hand: HandLink | None = None
    over: "asyncio.Future[DeniedError] | None" = None
    held: object = None
    panel: Panel | None = None


class DeniedError(Exception):
    """A token is not admitted, or no longer. The text says why, to whoever holds it. reason: under which it is counted."""

    def __init__(self, words: str, code: int = access.TOKEN, reason: str = "token") -> None:
        super().__init__(words)
        self.code, self.reason = code, reason


@dataclass(slots=True)
class PageServer:
    """Serves one port until `close`.

    assets   path -> file
    admit    gives what the holder of a token may see, or raises DeniedError; called with the token, whether the tab wants to
             move a device, and its address
    foxglove handler of a connection that speaks Foxglove's protocol, None where it is not offered
    most_bytes  of a message that a tab may send
    proxies  addresses whose word is taken for whom a request comes from (X-Forwarded-For)
    """

    access: Access
    assets: Mapping[str, ServedFile]
    policy: str
    admit: Callable[[str, bool, object], Awaitable[Admitted]]
    leave: Callable[[Admitted], None] = lambda admitted: None
    foxglove: Callable[[ServerConnection, Feed], Awaitable[None]] | None = None
    most_bytes: int = MOST_BYTES
    proxies: Collection[str] = ()
    visitors: Visitors = field(default_factory=lambda: Visitors(VisitorLimits(), secrets.randbits(64)))
    counts: Counter[str] = field(init=False, default_factory=Counter)
    _server: Server = field(init=False)
    _log: PeerLog = field(init=False)
    _once: dict[str, str] = field(init=False, default_factory=dict)

    async def listen(self, host: str, port: int, tls: ssl.SSLContext | None = None) -> None:
        """Begin to serve. Raises OSError where the port cannot be had."""
        self._log = bound_log()
        connection = cast("type[ServerConnection]", partial(_Connection, self))
        self._server = await serve(
            cast("Callable[[ServerConnection], Awaitable[None]]", self._talk), host, port, ssl=tls,
            ssl_handshake_timeout=None if tls is None else TLS_S, create_connection=connection, logger=LOG,
            process_request=cast("Callable[[ServerConnection, Request], Response | None]", self._answer),
            subprotocols=[OURS, *self._offered()],
            max_size=self.most_bytes + RESERVE_BYTES, compression=None, write_limit=WRITE_BYTES, max_queue=64,
            open_timeout=access.HELLO_S,
            server_header=None, ping_interval=20.0, ping_timeout=90.0, close_timeout=1.0,
        )  # fmt: skip

    @property
    def port(self) -> int:
        """Port that is served."""
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self, over: str = "") -> None:
        """End every connection and the server. over: why nobody need come back, a sentence for the user; "" where some may."""
        code, reason = (
            (access.OVER, over.encode()[:120].decode(errors="ignore")) if over else (1001, "the view is closed")
        )
        self._server.close(code=code, reason=reason)
        await self._server.wait_closed()
        self.counts["log line not shown"] += self._log.take_dropped()

    def open_once(self, url: str) -> str:
        """Return a path that leads to `url` the first time it is asked for: a token in a command line can be read by others."""
        code = secrets.token_urlsafe(16)
        self._once[f"/open/{code}"] = url
        return f"/open/{code}"

    def _offered(self) -> tuple[Subprotocol, ...]:
        return FOXGLOVE if self.foxglove is not None else ()

    # Requests --------------------------------------------------------------------------------------------------------

    def _answer(self, connection: "_Connection", request: Request) -> Response | None:
        """Return the answer to a request for a file or to one that is refused; None lets a websocket begin."""
        answer = self._judge(connection, request)
        connection.judged = answer is not None
        return answer

    def _judge(self, connection: "_Connection", request: Request) -> Response | None:
        path = _path(request)
        upgrade = "websocket" in ",".join(request.headers.get_all("Upgrade")).lower()
        if refusal := connection.identify(request.headers.get_all("X-Forwarded-For")):
            self.access.refused[refusal] += 1
            return self._response(HTTPStatus.BAD_REQUEST, f"{refusal}\n".encode())
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or len(origins) > 1:
            self.access.refused["malformed request"] += 1
            return self._response(HTTPStatus.BAD_REQUEST, b"one Host and at most one Origin\n")
        if getattr(request, "method", "GET") != "GET":  # older versions of websockets refuse it themselves
            self.access.refused["malformed request"] += 1
            return self._response(HTTPStatus.METHOD_NOT_ALLOWED, b"GET alone\n")
        if refusal := self.access.refusal(hosts[0], origins[0] if origins else None, path, upgrade=upgrade):
            return self._response(HTTPStatus.FORBIDDEN, f"{refusal}\n".encode())
        if upgrade:
            known = path == access.SOCKET or (path == access.FOXGLOVE and self.foxglove is not None)
            full = self.visitors.may_open(connection.client) if known else ""
            if known and not full:
                return None
            self.access.refused[full or "unknown path"] += 1
            status = HTTPStatus.SERVICE_UNAVAILABLE if known else HTTPStatus.NOT_FOUND
            return self._response(status, f"{full or status.phrase}\n".encode())
        if url := self._once.pop(path, ""):
            return self._response(HTTPStatus.SEE_OTHER, b"", location=url)
        asset = self.assets.get(path)
        if asset is None:
            self.access.refused["unknown path"] += 1
            return self._response(HTTPStatus.NOT_FOUND, b"there is no such page\n")
        return self._response(HTTPStatus.OK, asset.content, asset.content_type)

    def _response(
        self, status: HTTPStatus, body: bytes, content_type: str = "text/plain; charset=utf-8", location: str = ""
    ) -> Response:
        headers = Headers(access.HEADERS)
        headers["Content-Security-Policy"] = self.policy
        headers["Content-Type"] = content_type
        headers["Content-Length"] = str(len(body))
        headers["Connection"] = "close"
        if location:
            headers["Location"] = location
        return Response(status.value, status.phrase, headers, body)

    # Sockets ---------------------------------------------------------------------------------------------------------

    async def _talk(self, connection: "_Connection") -> None:
        address = connection.client
        connection.begun = True
        self.visitors.open_tab(address)
        try:
            await self._converse(connection)
        except ConnectionClosed as closed:
            if closed.sent is not None and not closed.rcvd_then_sent and closed.sent.code in PROTOCOL_ERRORS:
                self._count(PROTOCOL_ERRORS[closed.sent.code])
        finally:
            self.visitors.close_tab(address)

    async def _converse(self, connection: "_Connection") -> None:
        request = connection.request
        assert request is not None
        if _path(request) == access.FOXGLOVE:
            await self._foxglove(connection, request)
            return
        try:
            async with asyncio.timeout(access.HELLO_S):
                first = await connection.recv()
            if self._too_large(first):
                await self._refuse(connection, access.TOO_LARGE, "message too large")
                return
            hello = read_text(first) if isinstance(first, str) else None
            if not isinstance(hello, PageHello):
                raise PageError("the first message is not a hello")
        except TimeoutError:
            await self._refuse(connection, access.NO_HELLO, "no hello in time")
            return
        except PageError as error:
            await self._refuse(connection, access.MALFORMED, "malformed message", str(error))
            return
        admitted = await self._admitted(connection, hello.token, hello.hand)
        if admitted is None:
            return
        try:
            await self._show(connection, admitted)
        finally:
            self.leave(admitted)

    def _too_large(self, message: str | bytes) -> bool:
        return len(message.encode() if isinstance(message, str) else message) > self.most_bytes

    async def _admitted(self, connection: "_Connection", token: str, hand: bool) -> Admitted | None:
        """Return what the holder of a token may see, None where it was refused. Raises ConnectionClosed."""
        asked = asyncio.ensure_future(self.admit(token, hand, connection.client))
        closed = asyncio.create_task(connection.wait_closed())
        try:
            await asyncio.wait([asked, closed], return_when=asyncio.FIRST_COMPLETED)
            if asked.done():
                admitted = asked.result()
                connection.admitted = True
                return admitted
            asked.cancel()
            with suppress(asyncio.CancelledError, DeniedError):
                self.leave(await asked)  # it came through at the last moment
            raise connection.protocol.close_exc
        except DeniedError as denied:
            await self._refuse(connection, denied.code, denied.reason, str(denied))
        finally:
            closed.cancel()
        return None

    async def _show(self, connection: ServerConnection, admitted: Admitted) -> None:
        """Send what a tab is to see, and heed what it sends, until either end closes."""
        feed, hand, panel = admitted.feed, admitted.hand, admitted.panel
        waiting = asyncio.Event()
        tab = Tab(waiting.set)

        def take_over() -> None:
            tab.note, feed.tabs[tab] = "", True
            tab.say(scene_text(feed, tab, hand=True))

        moves = hand is not None and hand.take(tab, take_over)
        if hand is not None and not moves:
            tab.note = HAND_ELSEWHERE
        tab.say(scene_text(feed, tab, hand=moves))
        if panel is not None:
            panel.enter(tab)
        feed.tabs[tab] = moves
        if feed.frame is not None:
            tab.show(frames.encode(feed.frame))
        writer = asyncio.create_task(_write(connection, tab, waiting))
        watch = asyncio.create_task(self._end(connection, admitted))
        try:
            async for message in connection:
                if self._too_large(message):
                    refusal: Refusal | None = (access.TOO_LARGE, "message too large", "")
                elif isinstance(message, bytes):
                    refusal = self._move(message, hand if hand is not None and hand.moved_by(tab) else None)
                else:
                    refusal = await self._request(message, feed, panel, tab)
                if refusal:
                    await self._refuse(connection, *refusal)
                    return
        finally:
            writer.cancel()
            watch.cancel()
            del feed.tabs[tab]
            if panel is not None:
                panel.leave(tab)
            if hand is not None:
                hand.leave(tab)
            self.counts["frame replaced by a newer one"] += tab.replaced

    async def _end(self, connection: ServerConnection, admitted: Admitted) -> None:
        """Wait until who was admitted is no longer, and close."""
        if admitted.over is None:
            return
        denied = await asyncio.shield(admitted.over)
        await self._refuse(connection, denied.code, denied.reason, str(denied))

    def _move(self, message: bytes, hand: HandLink | None) -> Refusal | None:
        if hand is None:
            return access.NO_RIGHT, "pointer without a hand", "this page has no hand to move"
        try:
            pointer: Pointer = decode_pointer(message)
        except FrameError as error:
            return access.MALFORMED, "malformed pointer message", str(error)
        hand.send(pointer)
        return None

    async def _request(self, text: str, feed: Feed, panel: Panel | None, tab: Tab) -> Refusal | None:
        try:
            request = read_text(text)
            if isinstance(request, PanelReply):
                if panel is None:
                    return access.NO_RIGHT, "reply without a study", "this page asks nothing"
                panel.reply(request.number, request.text)
                return None
            if not isinstance(request, ChunkRequest):
                return access.MALFORMED, "second hello", ""
            tab.say(await asyncio.to_thread(feed.chunk, request.number))
        except PageError as error:
            return access.MALFORMED, "malformed message", str(error)
        except ChunkError:
            return access.MALFORMED, "no such chunk", ""
        return None

    async def _foxglove(self, connection: "_Connection", request: Request) -> None:
        token = parse_qs(request.path.partition("?")[2]).get("token", [""])[0]
        if connection.subprotocol not in FOXGLOVE or self.foxglove is None:
            await self._refuse(connection, 1002, "subprotocol", "ask for foxglove.sdk.v1 or foxglove.websocket.v1")
            return
        admitted = await self._admitted(connection, token, hand=False)
        if admitted is not None:
            watch = asyncio.create_task(self._end(connection, admitted))
            try:
                await self.foxglove(connection, admitted.feed)
            finally:
                watch.cancel()
                self.leave(admitted)

    async def _refuse(self, connection: ServerConnection, code: int, reason: str, words: str = "") -> None:
        self._count(reason)
        await connection.close(code, (words or reason).encode()[:120].decode(errors="ignore"))

    def _count(self, reason: str) -> None:
        self.access.refused[reason] += 1


def _is_defect(record: logging.LogRecord) -> bool:
    """Leave out what is no defect of ours: websockets fails at bytes behind a request that is refused."""
    kind = record.exc_info[0] if record.exc_info else None
    return not (kind is AssertionError and record.getMessage() == "unexpected internal error")


LOG = logging.getLogger("cogrip.view")
LOG.addFilter(_is_defect)


class _Connection(ServerConnection):
    """Connection that counts against the visitors' limits from its first byte; a malformed request is counted by name.

    admitted  its token is; before that control frames are bounded
    begun     it was talked with: what ends it is counted there
    judged    its request was refused, and counted
    """

    def __init__(self, page: PageServer, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._page = page
        self.client: object = None  # address of whoever asks
        self._counted = False
        self._control_frames = 0
        self.protocol.recv_frame = partial(self._read_frame, self.protocol.recv_frame)  # type: ignore[method-assign]
        self.admitted = self.begun = self.judged = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.client = self.remote_address
        if self._forwards:  # it has not said yet whom this is of
            return
        if refusal := self._connect():
            self._page.access.refused[refusal] += 1
            self.transport.abort()

    @property
    def _forwards(self) -> bool:
        """Return whether the other end is a proxy that is trusted."""
        peer = self.remote_address
        return bool(peer) and str(peer[0]).partition("%")[0] in self._page.proxies

    def _connect(self) -> str:
        self._counted = True
        return self._page.visitors.connect(self.client)

    def identify(self, forwarded: Sequence[str]) -> str:
        """Take the address that a trusted proxy has added last; return why the request is refused, "" if it is not."""
        if not self._forwards:
            return ""
        try:
            last = ",".join(forwarded).rpartition(",")[2].strip()
            self.client = (str(ip_address(last)), 0)
        except ValueError:
            return "the proxy does not say for whom (X-Forwarded-For)"
        return self._connect()

    def _read_frame(self, read: Callable[[Frame], None], frame: Frame) -> None:
        """Let the protocol read a frame, which answers a ping at once. Raises ProtocolError, which ends the connection."""
        if frame.opcode in CTRL_OPCODES and not self.admitted:
            self._control_frames += 1
            if self._control_frames > MOST_CONTROL_FRAMES:
                raise ProtocolError("too many control frames before the hello")
        read(frame)

    def connection_lost(self, exc: Exception | None) -> None:
        if self.request is None or self.protocol.handshake_exc is not None:
            self._page.access.refused["malformed request"] += 1
        elif not self.begun and not self.judged and isinstance(self.protocol.parser_exc, ProtocolError):
            self._page.access.refused[PROTOCOL_ERRORS[1002]] += 1
        if self._counted:
            self._page.visitors.disconnect(self.client)
        super().connection_lost(exc)


def _path(request: Request) -> str:
    return request.path.partition("?")[0]


async def _write(connection: ServerConnection, tab: Tab, waiting: asyncio.Event) -> None:
    """Send what a tab has waiting, as fast as its client takes it."""
    try:
        while True:
            await waiting.wait()
            waiting.clear()
            for message in tab.take():
                await connection.send(message)
    except ConnectionClosed:
        pass
