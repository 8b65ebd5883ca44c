"""`cogrip gateway` before an encrypted server: real processes, TLS with the server's certificate, people by their tokens."""

import asyncio
import hashlib
import json
import re
import secrets
import shutil
import signal
import socket
import ssl
import struct
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from pathlib import Path

import msgspec
import psutil
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus

from cogrip.devices.web.messages import Pointer, encode_pointer
from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.server.admission.token_keys import from_base64url
from cogrip.server.io.state_folder import find_folder
from cogrip.server.io.token_file import TokenFile, draw_token
from cogrip.view.frames import SceneFrame, decode
from cogrip.view.io.page_server import OURS
from cogrip.view.io.peer_log import LOG_LINES
from cogrip.view.visitors import VisitorLimits

from tests.live.held_arms import DEMO, Spoken
from tests.server.signers import Signer
from tests.view import event_loop
from tests.view.browser_page import Open
from tests.view.shown_page import frame_bytes, upgrade

LIMIT_S = 60.0
POINTER_S = 0.02


class Gated:
    """An encrypted server and a gateway before it, with the observer's link."""

    def __init__(self, folder: Path) -> None:
        self.state = folder / "state"
        self.server = Spoken(
            "serve", str(DEMO), "--port", "0", "--encrypted", "--state", str(self.state), "--set", "link.delay_ms=0",
            "--set", "admission.seats_per_token=1", "--seconds", "900", "--no-report", "--runs", str(folder),
        )  # fmt: skip
        self.server.hear("listening on")
        self.gateway = self.start("--port", "0", "--hands", "2", "--state", str(self.state))
        self.port = int(self.gateway.hear(r"gateway: https://127\.0\.0\.1:(\d+)/")[1])

    def start(self, *arguments: str) -> Spoken:
        gateway = Spoken("gateway", "-", *arguments, "--seconds", "600")
        gateway.tell(self.link("observer").text)
        return gateway

    def link(self, role: str) -> JoinLink:
        found = re.search(rf"as {role}: .*'(cogrip:\S+)'", self.server.said)
        assert found, self.server.said
        return parse_link(found[1])

    def new_token(self, **terms: object) -> tuple[str, str]:
        """Return a token of these terms, and its id."""
        token = draw_token()
        made = TokenFile(find_folder(self.state)).change(lambda book: book.new(token, time.time(), **terms))
        return token, made.id

    def signed(self, **terms: object) -> str:
        """Return a signed token of these terms; its key is the server's."""
        file, signer = TokenFile(find_folder(self.state)), Signer()
        if file.load().key(signer.kid) is None:
            file.change(lambda book: (book.add_key(signer.key()), None))
        now_s = int(time.time())
        return signer.token(
            aud=self.link("player").fingerprint,
            iat=now_s,
            exp=now_s + 600,
            room="demo",
            jti=secrets.token_hex(16),
            **terms,
        )

    def revoke(self, ident: str) -> None:
        TokenFile(find_folder(self.state)).change(lambda book: (book.revoke(ident, time.time()), None))
        self.server.popen.send_signal(signal.SIGHUP)  # it reads the tokens again

    @asynccontextmanager
    async def page(self, token: str, *, hand: bool = False) -> AsyncIterator[ClientConnection]:
        """Open a tab; its first message is the scene."""
        context = ssl.create_default_context()
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # its fingerprint is compared instead
        address = f"wss://127.0.0.1:{self.port}/socket"
        async with (
            asyncio.timeout(LIMIT_S),
            connect(  # what nobody reads must not stand before the answer to a close
                address, ssl=context, subprotocols=[OURS], origin=f"https://127.0.0.1:{self.port}", max_queue=None
            ) as tab,
        ):
            shown = tab.transport.get_extra_info("ssl_object").getpeercert(binary_form=True)
            assert hashlib.sha256(shown).hexdigest() == self.link("player").fingerprint
            await tab.send(json.dumps({"type": "hello", "token": token, "hand": hand}))
            yield tab

    async def refused(self, token: str, *, hand: bool = False) -> tuple[int, str]:
        """Return code and words with which a tab is closed."""
        async with self.page(token, hand=hand) as tab:
            return await closed(tab)


async def closed(tab: ClientConnection) -> tuple[int, str]:
    try:
        async for _ in tab:
            pass
    except ConnectionClosed:
        pass
    return tab.close_code or 0, tab.close_reason or ""


async def frame(tab: ClientConnection) -> SceneFrame:
    """Return the next frame."""
    while True:
        message = await tab.recv()
        if isinstance(message, bytes) and message[0] == 1:
            return decode(message)


async def pull(tab: ClientConnection, target_m: float) -> None:
    """Hold the device, its hand going to a place, until the tab is closed."""
    number = 0
    while True:
        number += 1
        await tab.send(encode_pointer(Pointer(number, True, (target_m, 0.0, 0.0))))
        await asyncio.sleep(POINTER_S)


@asynccontextmanager
async def pulling(tab: ClientConnection, target_m: float) -> AsyncIterator[None]:
    task = asyncio.create_task(pull(tab, target_m))
    try:
        yield
    finally:
        task.cancel()


@pytest.fixture(scope="module")
def gated(tmp_path_factory) -> Iterator[Gated]:
    gated = Gated(tmp_path_factory.mktemp("gated"))
    yield gated
    gated.gateway.stop()
    gated.server.stop()


@pytest.mark.long
async def test_a_hand_by_its_token_moves_the_servers_object_and_a_revocation_ends_it(gated):
    token, ident = gated.new_token(role="player", user="ben")
    observer = gated.link("observer").token
    async with gated.page(token, hand=True) as held, gated.page(observer) as shown:
        scene = msgspec.json.decode(await held.recv())
        assert (scene["hand"], scene["own_seat"]) == (True, 1)
        assert msgspec.json.decode(await shown.recv())["hand"] is False
        async with pulling(held, 0.03):
            while (await frame(shown)).position_m[0] < 0.02:
                await held.recv()  # its own picture goes on beside
            gated.revoke(ident)
            code, words = await closed(held)
        assert code == 4403
        assert "revoked" in words
        while (await frame(shown)).people:  # its seat is free again
            pass
    code, words = await gated.refused(token, hand=True)
    assert (code, "was revoked at" in words) == (4401, True), words


async def test_a_signed_token_opens_a_page_and_holds_a_hand_and_a_revocation_ends_both(gated):
    token = gated.signed(role="player", seat="anna", once=True)
    jti = json.loads(from_base64url(token.split(".")[1]))["jti"]
    async with gated.page(token, hand=True) as held:
        assert msgspec.json.decode(await held.recv())["hand"] is True
        used = (4401, "this token was used already: it is good for one time; ask for a new link")
        assert await gated.refused(token, hand=True) == used
        edit = lambda book: (book.spend(jti, "revoke", time.time() + 600, time.time()), None)  # noqa: E731
        TokenFile(find_folder(gated.state)).change(edit)
        gated.server.popen.send_signal(signal.SIGHUP)
        code, words = await closed(held)
        assert (code, "revoked" in words) == (4403, True), words
    async with gated.page(gated.signed(role="observer")) as shown:
        assert msgspec.json.decode(await shown.recv())["room"] == "demo"
    changed = gated.signed(role="observer")
    code, words = await gated.refused(f"{changed[:-6]}AAAAAA")
    assert (code, words) == (4401, "this token has no signature by the key 'uni'; ask for a new link")


async def test_an_observers_tabs_share_one_session_which_a_revocation_ends(gated):
    token, ident = gated.new_token(role="observer", once=True)  # a second session of it would be refused
    async with gated.page(token) as one, gated.page(token) as two:
        for tab in (one, two):
            assert msgspec.json.decode(await tab.recv())["room"] == "demo"
            await frame(tab)
        gated.revoke(ident)
        for tab in (one, two):
            code, words = await closed(tab)
            assert (code, "revoked" in words) == (4401, True), words


async def test_a_token_for_one_time_takes_one_hand(gated):
    token, _ = gated.new_token(role="player", once=True)
    async with gated.page(token, hand=True) as held:
        assert msgspec.json.decode(await held.recv())["hand"] is True
    code, words = await gated.refused(token, hand=True)
    assert (code, words) == (4401, "this token was used already: it is good for one time; ask for a new link")


async def test_the_servers_refusals_reach_the_page_in_its_words(gated):
    observer, player = gated.link("observer").token, gated.link("player").token
    expired, _ = gated.new_token(role="player", expires=1)
    assert await gated.refused(draw_token()) == (4401, "this token is unknown here; ask for a new link")
    code, words = await gated.refused("no token")
    assert (code, "has no token" in words) == (4401, True)
    late, looks_on = await asyncio.gather(gated.refused(expired, hand=True), gated.refused(observer, hand=True))
    assert (late[0], "this token has expired" in late[1]) == (4401, True), late
    assert looks_on == (4403, "this link is for observing: ask for a player's link to hold the object")
    async with gated.page(player, hand=True) as held:
        await held.recv()
        code, words = await gated.refused(player, hand=True)
        assert (code, "holds 1 seats already" in words) == (4401, True), words
        other, _ = gated.new_token(role="player")
        async with gated.page(other, hand=True) as second:
            await second.recv()
            code, words = await gated.refused(other, hand=True)  # --hands 2
            assert (code, "all 2 hands of this gateway are taken" in words) == (4403, True), words


async def test_a_page_that_goes_over_tls_goes_over_nothing_else(gated):
    with pytest.raises((InvalidMessage, ConnectionError, EOFError, InvalidStatus)):
        await connect(f"ws://127.0.0.1:{gated.port}/socket", subprotocols=[OURS])


async def test_a_gateway_says_what_it_refused_and_shows_no_token_of_others(gated):
    gateway = gated.start("--port", "0")
    found = gateway.hear(r"gateway: http://127\.0\.0\.1:(\d+)/")
    gateway.hear("hold: ")
    secret = draw_token()
    async with connect(f"ws://127.0.0.1:{found[1]}/socket", subprotocols=[OURS]) as tab:
        await tab.send(json.dumps({"type": "hello", "token": secret}))
        assert (await closed(tab))[0] == 4401
    gateway.popen.terminate()
    assert gateway.end() == 0
    assert "gateway: token 1" in gateway.said
    assert secret not in gateway.said
    gateway.stop()


FLOODS = 60  # connections of each kind
PINGS = frame_bytes(b"", 9) * 2000


def attacks(port: int) -> list[bytes]:
    """Return what is sent once a connection is open, over TLS or not."""
    return [
        upgrade(port) + PINGS,
        upgrade(port) + frame_bytes(b"x", 1, 0) + frame_bytes(b"", 0, 0) * 2000,
        upgrade(port, path="/none") + PINGS,
        upgrade(port, host="evil:1") + PINGS,
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 500,
        b"\x16\x03\x01" + bytes(5000),
        b"",
    ]


def attack(port: int, data: bytes, context: ssl.SSLContext | None) -> None:
    """Send it and reset the connection. context: None for no TLS, whatever the server speaks."""
    with suppress(OSError), socket.create_connection(("127.0.0.1", port), LIMIT_S) as raw:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer = raw if context is None else context.wrap_socket(raw)
        with peer, suppress(OSError):
            peer.sendall(data)


@pytest.mark.parametrize("tls", [False, True])
def test_whoever_has_no_token_fills_no_log(gated, tls):
    """Not by pings whose answers nobody takes, nor by anything else: lines of all loggers have one budget."""
    began_s = time.monotonic()
    gateway = gated.start("--port", "0", *(["--state", str(gated.state)] if tls else []))
    port = int(gateway.hear(r"gateway: https?://[\d.]+:(\d+)/")[1])
    gateway.hear("hold: ")
    context = ssl.create_default_context() if tls else None
    if context is not None:
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    for data in attacks(port) * FLOODS:
        attack(port, data, context)
        if tls:
            attack(port, data, None)
    gateway.popen.terminate()
    assert gateway.end() == 0
    assert "malformed" in gateway.said
    most = LOG_LINES.burst + LOG_LINES.per_second * (time.monotonic() - began_s) + 20  # its own words at start and end
    assert gateway.said.count("\n") <= most, gateway.said
    gateway.stop()


def test_a_proxy_that_ends_tls_is_believed_about_whom_it_asks_for_and_nobody_else_is(gated: Gated) -> None:
    """The proxy's part is played over real sockets: what nginx sends by the recipe of docs/view.md."""
    gateway = gated.start("--port", "0", "--public", "https://touch.example.org", "--trust-proxy", "127.0.0.1")
    gateway.hear(r"gateway: https://touch\.example\.org/\n")
    gateway.hear(r"observe:  https://touch\.example\.org/#")
    (port,) = listening(gateway.popen.pid)
    token = gated.link("observer").token

    def tab(origin: str = "https://touch.example.org", **headers: str) -> connect:
        given = {name.replace("_", "-"): value for name, value in headers.items()}
        return connect(
            "ws://touch.example.org/socket", host="127.0.0.1", port=port, subprotocols=[OURS], origin=origin,
            additional_headers=given, max_queue=None, proxy=None,
        )  # fmt: skip

    async def status(**asked: str) -> int:
        try:
            async with tab(**asked):
                return 101
        except InvalidStatus as refused:
            return refused.response.status_code

    async def ask() -> None:
        async with asyncio.timeout(LIMIT_S), AsyncExitStack() as stack:
            one = await stack.enter_async_context(tab(X_Forwarded_For="198.51.100.9, 203.0.113.7"))
            await one.send(json.dumps({"type": "hello", "token": token, "hand": False}))
            assert json.loads(await one.recv())["type"] == "scene"
            assert await status() == 400, "for whom?"
            assert await status(X_Forwarded_For="203.0.113.7, nobody") == 400
            assert await status(X_Forwarded_For="203.0.113.7", origin="https://elsewhere.example") == 403
            assert await status(X_Forwarded_For="203.0.113.7", origin="http://touch.example.org") == 403
            for _ in range(VisitorLimits().tabs_each - 1):
                await stack.enter_async_context(tab(X_Forwarded_For="203.0.113.7"))
            assert await status(X_Forwarded_For="203.0.113.7") == 503
            assert await status(X_Forwarded_For="203.0.113.7, 203.0.113.8") == 101, "one address has its own limit"

    event_loop.run(ask())


NGINX = """
daemon off; master_process off; pid {folder}/pid; error_log {folder}/errors;
events {{ }}
http {{
    access_log off;
    client_body_temp_path {folder}; proxy_temp_path {folder}; fastcgi_temp_path {folder}; uwsgi_temp_path {folder};
    scgi_temp_path {folder};
    server {{
        listen 127.0.0.1:{port} ssl;
        server_name localhost;
        ssl_certificate {state}/server.crt;
        ssl_certificate_key {state}/server.key;
        {recipe}
    }}
}}
"""


@contextmanager
def proxied(folder: Path, port: int, gateway_port: int, state: Path) -> Iterator[None]:
    """Run nginx by the recipe of docs/view.md, with TLS by the server's certificate."""
    program = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin:/usr/local/sbin")
    if program is None:
        pytest.skip("there is no nginx on this machine")
    text = (DEMO.parents[1] / "docs" / "view.md").read_text("utf-8")
    recipe = re.search(r"^```\n(location / \{.*?^\})\n```", text, re.MULTILINE | re.DOTALL)
    assert recipe
    assert "127.0.0.1:47880" in recipe[1]
    config = folder / "nginx.conf"
    config.write_text(
        NGINX.format(folder=folder, port=port, state=state, recipe=recipe[1].replace(":47880", f":{gateway_port}"))
    )
    process = subprocess.Popen([program, "-c", config, "-p", folder, "-e", folder / "errors"])
    try:
        while True:  # until it listens
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), LIMIT_S):
                break
            assert process.poll() is None, (folder / "errors").read_text()
        yield
    finally:
        process.terminate()
        process.wait()


def test_the_page_is_shown_and_held_through_nginx_by_the_recipe(gated: Gated, open_page: Open, tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    origin = f"https://localhost:{port}"
    gateway = gated.start("--port", "0", "--public", origin, "--trust-proxy", "127.0.0.1")
    found = gateway.hear(rf"observe:  ({origin}/#\S+)")
    (behind,) = listening(gateway.popen.pid)
    player, _ = gated.new_token(role="player")
    try:
        with proxied(tmp_path, port, behind, gated.state):
            page = open_page(found[1], ignore_https_errors=True)
            page.until("cogrip.scene !== null && cogrip.frame !== null")
            page.tab.goto("about:blank")
            page.tab.goto(f"{origin}/#{player}&hand")
            page.until("cogrip.scene?.hand && cogrip.frame?.people.length === 1")
            assert page.state("cogrip.frame.people[0].state") in ("joining", "live")
    finally:
        gateway.stop()


def listening(pid: int) -> list[int]:
    """Return the TCP ports at which a process listens."""
    return [each.laddr.port for each in psutil.Process(pid).net_connections("tcp") if each.status == psutil.CONN_LISTEN]
