"""The page server refuses what is not its page's, by real sockets, and counts every refusal by name."""

import asyncio
import struct
from collections.abc import Callable

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from cogrip.devices.web.messages import Pointer, encode_pointer
from cogrip.view import access
from cogrip.view.frames import decode
from cogrip.view.io.page_server import MOST_CONTROL_FRAMES, OURS
from cogrip.view.visitors import VisitorLimits

from tests.view.shown_page import (
    BINARY,
    HELLO,
    LIMIT_S,
    TEXT,
    TOKEN,
    RawClient,
    frame_bytes,
    shown_page,
    until,
    upgrade,
)

POINTER = encode_pointer(Pointer(1, True, (0.0, 0.0, 0.0)))
CHUNK = '{"type":"chunk","number":0}'
PING, PONG = 9, 10
OTHER_ORIGIN, MALFORMED = "Origin is not this page's (socket)", "malformed request"


def text(said: str) -> bytes:
    return frame_bytes(said.encode(), TEXT)


def page(port: int, *lines: str, path: str = "/", host: str | None = None) -> bytes:
    headers = [f"GET {path} HTTP/1.1", f"Host: {f'127.0.0.1:{port}' if host is None else host}", *lines]
    return "\r\n".join([*headers, "", ""]).encode()


REQUESTS: dict[str, tuple[Callable[[int], bytes], int, str]] = {
    # name: request to a port, status of the answer (0: none), name of the count
    "another name of this machine": (lambda port: page(port, host=f"evil.example:{port}"), 403, "Host is not this page's"),
    "another port": (lambda port: page(port, host=f"127.0.0.1:{port + 1}"), 403, "Host is not this page's"),
    "localhost, which was not named": (lambda port: page(port, host=f"localhost:{port}"), 403, "Host is not this page's"),
    "no Host": (lambda port: b"GET / HTTP/1.1\r\n\r\n", 400, "malformed request"),
    "two Hosts": (lambda port: page(port, f"Host: 127.0.0.1:{port}"), 400, "malformed request"),
    "another Origin": (lambda port: page(port, "Origin: https://evil.example"), 403, "Origin is not this page's"),
    "another path": (lambda port: page(port, path="/../etc/passwd"), 404, "unknown path"),
    "an opening code that was not given": (lambda port: page(port, path="/open/guess"), 404, "unknown path"),
    "POST": (lambda port: page(port).replace(b"GET", b"POST"), 405, "malformed request"),
    "no HTTP": (lambda port: b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", 0, "malformed request"),
    "an endless line": (lambda port: page(port, path="/" + "a" * 20_000), 414, "malformed request"),
    "endless headers": (lambda port: page(port, *["X: y"] * 300), 431, "malformed request"),
    "a socket by another name": (lambda port: upgrade(port, host=f"evil:{port}"), 403, "Host is not this page's (socket)"),
    "a socket of another Origin": (lambda port: upgrade(port, "Origin: https://evil.example"), 403, OTHER_ORIGIN),
    "a socket of a page on a disk": (lambda port: upgrade(port, "Origin: null"), 403, OTHER_ORIGIN),
    "a socket of this page over TLS": (lambda port: upgrade(port, f"Origin: https://127.0.0.1:{port}"), 403, OTHER_ORIGIN),
    "a socket with two Origins": (
        lambda port: upgrade(port, f"Origin: http://127.0.0.1:{port}", "Origin: https://evil.example"), 400, MALFORMED
    ),
    "a socket elsewhere": (lambda port: upgrade(port, path="/sockets"), 404, "unknown path"),
    "Foxglove, which is not offered": (lambda port: upgrade(port, path="/foxglove"), 404, "unknown path"),
    "a socket without a key": (lambda port: upgrade(port).replace(b"Sec-WebSocket-Key", b"X-Key"), 400, MALFORMED),
    "an old version of websockets": (lambda port: upgrade(port).replace(b"Version: 13", b"Version: 8"), 400, MALFORMED),
}  # fmt: skip


@pytest.mark.parametrize("name", REQUESTS)
async def test_a_request_that_is_not_this_pages_is_refused_and_counted_once(name):
    request, status, reason = REQUESTS[name]
    async with shown_page() as shown:
        client = await RawClient.connect(shown.server.port)
        answer = await client.ask(request(shown.server.port))
        assert answer.startswith(b"HTTP/1.1 %d" % status) if status else answer == b"", answer
        assert TOKEN.encode() not in answer
        assert await client.closed() == 0
        assert await shown.until_refused(1) == {reason: 1}
        assert shown.entered == 0


async def test_whoever_sends_nothing_is_ended_and_counted(monkeypatch):
    monkeypatch.setattr(access, "HELLO_S", 0.01)
    async with shown_page() as shown:
        client = await RawClient.connect(shown.server.port)
        assert await client.closed() == 0
        assert await shown.until_refused(1) == {"malformed request": 1}


@pytest.mark.parametrize("origin", [None, "own", "https://front.example", "HTTPS://FRONT.example"])
async def test_the_page_itself_programs_and_allowed_front_ends_come_in(origin):
    async with shown_page() as shown:
        own = f"http://127.0.0.1:{shown.server.port}"
        lines = [] if origin is None else [f"Origin: {own if origin == 'own' else origin}"]
        client = await RawClient.connect(shown.server.port)
        assert (await client.ask(upgrade(shown.server.port, *lines))).startswith(b"HTTP/1.1 101")
        client.send(HELLO.encode())
        opcode, scene = await client.read()
        assert opcode == TEXT
        assert b'"type":"scene"' in scene
        client.abort()
        await shown.until_nobody()
        assert shown.refused == {}
        assert shown.entered == shown.left == 1


async def test_every_answer_carries_the_policy():
    async with shown_page() as shown:
        for path in ("/", "/none"):
            client = await RawClient.connect(shown.server.port)
            head = (await client.ask(page(shown.server.port, path=path))).decode()
            client.abort()
            assert "Content-Security-Policy: default-src 'none'" in head
            assert "X-Content-Type-Options: nosniff" in head
            assert "Referrer-Policy: no-referrer" in head
            assert "Cache-Control: no-store" in head


MESSAGES: dict[str, tuple[list[bytes], int, str]] = {
    # name: what is sent once the socket is open, code with which it is closed, name of the count
    "another token": ([text(HELLO.replace(TOKEN, "wrong"))], 4401, "token"),
    "no token": ([text('{"type":"hello"}')], 4400, "malformed message"),
    "a token without end": ([text(HELLO.replace(TOKEN, "t" * 641))], 4400, "malformed message"),
    "no JSON": ([text("hello")], 4400, "malformed message"),
    "JSON without end": ([frame_bytes(b"[" * 4000, TEXT)], 4400, "malformed message"),
    "another type": ([text('{"type":"order"}')], 4400, "malformed message"),
    "an unknown field": ([text(HELLO.replace("}", ',"x":1}'))], 4400, "malformed message"),
    "bytes first": ([frame_bytes(POINTER, BINARY)], 4400, "malformed message"),
    "a chunk first": ([text(CHUNK)], 4400, "malformed message"),
    "a second hello": ([text(HELLO)] * 2, 4400, "second hello"),
    "a pointer without a hand": ([text(HELLO), frame_bytes(POINTER, BINARY)], 4403, "pointer without a hand"),
    "a chunk that is not there": ([text(HELLO), text(CHUNK)], 4400, "no such chunk"),
    "no JSON later": ([text(HELLO), text("?")], 4400, "malformed message"),
    "4097 bytes": ([frame_bytes(b" " * 4097, TEXT)], 4413, "message too large"),
    "4097 bytes later": ([text(HELLO), frame_bytes(b" " * 4097, BINARY)], 4413, "message too large"),
    "2049 letters of two bytes": ([frame_bytes("ä".encode() * 2049, TEXT)], 4413, "message too large"),
    "a message that says it has 1 GB": ([struct.pack("!BBQ", 0x81, 0xFF, 2**30) + b"\0" * 4], 1009, "message too large"),
    "fragments without end": (
        [frame_bytes(b" " * 4000, TEXT, 0), *[frame_bytes(b" " * 4000, 0, 0)] * 2], 1009, "message too large"
    ),
    "no UTF-8": ([frame_bytes(b"\xff\xfe", TEXT)], 1007, "text that is not UTF-8"),
    "no mask": ([frame_bytes(HELLO.encode(), TEXT, masked=False)], 1002, "malformed websocket frame"),
    "a reserved bit": ([frame_bytes(HELLO.encode(), TEXT, 0xC0)], 1002, "malformed websocket frame"),
    "a reserved opcode": ([frame_bytes(b"", 3)], 1002, "malformed websocket frame"),
    "a long ping": ([frame_bytes(b"p" * 126, 9)], 1002, "malformed websocket frame"),
    "a continuation of nothing": ([frame_bytes(b"", 0)], 1002, "malformed websocket frame"),
}  # fmt: skip


@pytest.mark.parametrize("name", MESSAGES)
async def test_a_message_that_is_none_closes_its_socket_and_is_counted_once(name):
    sent, code, reason = MESSAGES[name]
    async with shown_page() as shown:
        client = await RawClient.upgraded(shown.server.port)
        for frame in sent:
            client.write(frame)
        assert await client.closed() == code
        assert await shown.until_refused(1) == {reason: 1}
        await shown.until_nobody()
        assert shown.entered == shown.left
        assert shown.feed.tabs == {}


@pytest.mark.parametrize("opcode", [PING, PONG])
async def test_control_frames_are_bounded_until_the_token_is_admitted(opcode):
    async with shown_page() as shown:
        client = await RawClient.upgraded(shown.server.port)
        client.write(frame_bytes(b"", opcode) * (MOST_CONTROL_FRAMES + 1))
        assert await client.closed() == 1002
        assert await shown.until_refused(1) == {"malformed websocket frame": 1}
        client = await RawClient.connect(shown.server.port)  # right behind the request
        await client.ask(upgrade(shown.server.port) + frame_bytes(b"", opcode) * (MOST_CONTROL_FRAMES + 1))
        await client.closed()
        assert await shown.until_refused(2) == {"malformed websocket frame": 2}
        client = await RawClient.upgraded(shown.server.port)
        client.write(frame_bytes(b"", opcode) * MOST_CONTROL_FRAMES)
        client.send(HELLO.encode())
        for _ in range(MOST_CONTROL_FRAMES if opcode == PING else 0):
            assert await client.read() == (PONG, b"")
        assert (await client.read())[1].startswith(b'{"type":"scene"')
        client.write(frame_bytes(b"", PING) * MOST_CONTROL_FRAMES)
        for _ in range(MOST_CONTROL_FRAMES):
            assert await client.read() == (PONG, b"")
        client.abort()
        await shown.until_nobody()
        assert shown.entered == 1


async def test_whoever_says_no_hello_is_ended(monkeypatch):
    async with shown_page() as shown:
        monkeypatch.setattr(access, "HELLO_S", 0.0)  # the request has its own time, as the server began with it
        client = await RawClient.upgraded(shown.server.port)
        assert await client.closed() == 4408
        assert await shown.until_refused(1) == {"no hello in time": 1}


async def test_the_websockets_package_is_refused_alike():
    async with shown_page() as shown:
        address = f"ws://127.0.0.1:{shown.server.port}/socket"
        with pytest.raises(InvalidStatus, match="403"):
            await connect(address, origin="https://evil.example", subprotocols=[OURS])
        with pytest.raises(InvalidStatus, match="400"):
            await connect(address)
        async with connect(address, subprotocols=[OURS]) as socket:
            await socket.send(HELLO.replace(TOKEN, "wrong"))
            with pytest.raises(ConnectionClosed) as closed:
                await socket.recv()
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (4401, "no such token")
        assert shown.refused == {"Origin is not this page's (socket)": 1, "malformed request": 1, "token": 1}


async def test_the_opening_path_works_once_and_under_this_name_alone():
    async with shown_page() as shown:
        path = shown.server.open_once("/#secret")
        answers = []
        for host in ("evil.example", None, None):
            client = await RawClient.connect(shown.server.port)
            answers.append(await client.ask(page(shown.server.port, path=path, host=host)))
            client.abort()
        assert [answer[:12] for answer in answers] == [b"HTTP/1.1 403", b"HTTP/1.1 303", b"HTTP/1.1 404"]
        assert b"Location: /#secret\r\n" in answers[1]
        assert b"secret" not in answers[0] + answers[2]
        assert shown.refused == {"Host is not this page's": 1, "unknown path": 1}


async def test_a_tab_that_does_not_read_gets_the_newest_frame_and_keeps_no_queue():
    frames = 40_000  # 4 MB: more than both systems' buffers take
    async with shown_page() as shown:
        client = await RawClient.upgraded(shown.server.port)
        client._reader._limit = 1024  # so that the system's buffer alone takes what is not read
        client.send(HELLO.encode())
        await until(lambda: bool(shown.feed.tabs))
        (tab,) = shown.feed.tabs
        (connection,) = shown.server._server.connections
        for number in range(frames):
            shown.feed.show(number)
            assert len(tab._newest) <= 1
            assert connection.transport.get_write_buffer_size() < 80_000
            if number % 4 == 0:
                await asyncio.sleep(0)
        assert tab.replaced > frames / 2
        numbers: list[int] = []
        while not numbers or numbers[-1] < frames - 1:
            async with asyncio.timeout(LIMIT_S):
                opcode, message = await client.read()
            if opcode == BINARY:
                numbers.append(decode(message).number)
        assert numbers == sorted(set(numbers))
        assert len(numbers) + tab.replaced == frames
        client.abort()


async def test_tabs_and_connections_are_bounded_in_all_and_for_each_address():
    async with shown_page(VisitorLimits(connections=5, tabs=2, tabs_each=8)) as shown:
        port = shown.server.port
        tabs = [await RawClient.upgraded(port) for _ in range(2)]
        third = await RawClient.connect(port)
        assert (await third.ask(upgrade(port))).startswith(b"HTTP/1.1 503")
        assert shown.refused == {"too many tabs": 1}
        others = [await RawClient.connect(port) for _ in range(5)]
        await until(lambda: "too many connections" in shown.refused)
        for client in (*others, third, tabs.pop()):
            client.abort()
        await until(lambda: shown.server.visitors.tabs <= 1)
        tabs.append(await RawClient.upgraded(port))  # there is room again
        for client in tabs:
            client.abort()
