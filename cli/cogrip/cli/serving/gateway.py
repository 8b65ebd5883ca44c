"""`cogrip gateway`: the page and a hand for people who have only a browser."""

import sys
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.serving.gateway_certificate import tls_of
from cogrip.cli.serving.server_state import WILDCARDS, own_address, place_of
from cogrip.cli.session.children import reason_in
from cogrip.cli.session.front_ends import FoxgloveOrigins, front_ends
from cogrip.cli.session.join_target import JoinTarget, target_of, typed
from cogrip.cli.session.loopback import is_loopback
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem, at_least_one, some_time, within
from cogrip.cli.terminal.qr_code import print_qr_code
from cogrip.client.io.paths import JoinError
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.wire.join_link import DEFAULT_PORT, JoinLink, place_text
from cogrip.protocol.wire.session import ClientSession
from cogrip.view.io.feed import LiveFeed
from cogrip.view.io.gateway import Gateway
from cogrip.view.io.hand_process import HandProcess
from cogrip.view.io.platform import STARTS_HANDS
from cogrip.view.io.process import ListeningError

USUAL_PORTS = {"http": 80, "https": 443}  # ports that browsers leave out of an address


def gateway(
    link: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    room: str = "",
    public: tuple[str, ...] = (),
    state: Path | None = None,
    trust_proxy: tuple[str, ...] = (),
    certificate: Path | None = None,
    key: Path | None = None,
    hands: int = 16,
    foxglove: Annotated[bool, Parameter(negative="")] = False,
    foxglove_origin: FoxgloveOrigins = (),
    qr: bool = True,
    hand: Annotated[bool, Parameter(negative="")] = False,
    links: bool = True,
    seconds: float | None = None,
) -> int:
    """Serve the page to people who have only a browser; with a player's token they hold the object by mouse, finger or gamepad.

    Everyone is an ordinary encrypted player or observer of the server, by the token in the address of the page: that of LINK,
    or any other of the server (`cogrip token new`): put it in the place of the one behind the #. Beyond loopback the page
    is served over TLS only.

    Parameters
    ----------
    link
        A join link of the server, in quotes: an observer's, or a player's if everyone who gets the page may hold the object.
        - reads it from standard input.
    host
        Address to listen on: 0.0.0.0 for all of this machine.
    port
        TCP port of the page; 0 takes a free one.
    room
        Room, where the link is for any.
    public
        HOST or HOST:PORT by which people reach this machine; may be given several times. Guessed if not given. A whole
        origin, https://HOST or https://HOST:PORT, where a proxy ends TLS before the gateway.
    trust_proxy
        Address of such a proxy, whose X-Forwarded-For says whom limits are for; may be given several times.
    state
        State folder of the server, whose certificate is used. Found if not given, where the server runs on this machine as
        this user; else the gateway makes a certificate of its own.
    certificate
        File with a certificate that browsers know, and those that vouch for it (PEM).
    key
        File with its private key (PEM).
    hands
        People who can hold the object at once: each is a process of some 70 MB and a tenth of a processor here.
    foxglove
        Offer the session to Foxglove and Lichtblick, too: their programs, app.foxglove.dev, and pages of this machine.
    qr
        Print a QR code of the page's address, at a terminal with room for it.
    hand
        Let the QR code ask for a hand; LINK has to be a player's.
    links
        Print the addresses with the token. Leave them out of a journal.
    seconds
        End after this time.
    """
    some_time(seconds, "serve pages")
    within("--port", port, 0, 65535)
    at_least_one("--hands", hands)
    offered = front_ends(foxglove, foxglove_origin)
    console = make_console(soft_wrap=True)
    if not STARTS_HANDS:
        raise BadInput(
            "gateway: needs an event loop that watches sockets and processes, as Linux and macOS have; run it there"
        )
    target = target_of(typed(link, more), room, insecure=False, name="", digest="")
    if not target.fingerprint:
        raise BadInput(
            "gateway: a join link is needed (cogrip://...): people are let in by its tokens; `cogrip serve --encrypted`"
        )
    loopback = is_loopback(host)
    origins = [_origin(each) for each in public if "://" in each]
    names = _names(tuple(each for each in public if "://" not in each), host)
    proxies = [_proxy(each) for each in trust_proxy]
    tls, fingerprint = tls_of(state, certificate, key, target, loopback)
    stop = Stop()
    scheme = "http" if tls is None else "https"

    def ready(bound: int) -> None:
        place = _places(names[:1], bound, scheme)[0]
        page = f"{origins[0]}/" if origins else f"{scheme}://{place}/"
        console.print(f"gateway: {page}")
        if fingerprint:
            console.print(f"certificate: SHA-256 {fingerprint}")
            console.print("browsers warn of it, as nobody vouches for it: compare the fingerprint, then go on")
        if not public and host in WILDCARDS:
            console.print(
                f"addresses name {names[0][0]}, which is a guess; --public HOST if people reach this machine by another"
            )
        if links:
            console.print(f"observe:  {page}#{target.token}")
            console.print(f"hold:     {page}#{target.token}&hand  (if the link is a player's)")
            if foxglove:
                console.print(f"Foxglove: {page.replace('http', 'ws', 1)}foxglove?token={target.token}")
            if qr:
                print_qr_code(f"{page}#{target.token}{'&hand' if hand else ''}", console)

    with (
        on_signals(stop),
        Problem.of(JoinError, ListeningError),
        tempfile.TemporaryDirectory(prefix="cogrip-gateway-") as folder,
        closing(target.paths(insecure=False)),
    ):
        own = _feed(target, "", console.print)
        own.connect()
        # Everyone enters the room that the gateway shows, whatever rooms a token is for.
        target = replace(target, room=own.scene.room)
        process = Gateway(
            own, target.token, lambda token: _feed(target, token, lambda _: None),
            lambda: HandProcess(lambda fd: _hand_command(fd, target.room, folder), reason_in),
            lambda token: JoinLink(target.host, target.port, target.room, target.fingerprint, token).text,
            lambda bound: _places(names, bound, scheme), stop, ready, host, port, tls, hands, foxglove, offered, seconds,
            origins, proxies,
        )  # fmt: skip
        ended = process.run()
    if counts := {name: count for name, count in sorted(process.counts.items()) if count}:
        console.print("gateway: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    if ended:
        console.print(f"gateway: the session is over: {ended}")
    return 1 if ended else 0


def _feed(target: JoinTarget, token: str, say: Callable[[str], None]) -> LiveFeed:
    asked = replace(target, token=token or target.token)
    return LiveFeed(ClientSession(asked.observer()), asked.paths(insecure=False), say)


def _hand_command(fd: int, room: str, folder: str) -> list[str]:
    """Return the command of a player whose device is at the other end of `fd`, its link read from standard input."""
    return [
        sys.executable, "-P", "-u", "-m", "cogrip.cli", "join", "-", "--device", f"web:pointer?fd={fd}", "--room", room,
        "--into", folder, "--no-record", "--no-report", "--quiet", "--no-rearm",
    ]  # fmt: skip


def _origin(text: str) -> str:
    """Return an origin as browsers write it. Raises BadInput."""
    scheme, _, place = text.lower().rstrip("/").partition("://")
    if scheme not in USUAL_PORTS:
        raise BadInput(f"--public {text}: an origin begins with https:// or http://; or write HOST or HOST:PORT")
    name, port = place_of(place, USUAL_PORTS[scheme])
    whole = place_text(name, port)
    return f"{scheme}://{whole.rpartition(':')[0] if port == USUAL_PORTS[scheme] else whole}"


def _proxy(text: str) -> str:
    """Return the address of a proxy as a socket says it. Raises BadInput."""
    try:
        return str(ip_address(text))
    except ValueError:
        raise BadInput(f"--trust-proxy {text}: give the proxy's address, such as 127.0.0.1") from None


def _names(public: tuple[str, ...], host: str) -> list[tuple[str, int]]:
    """Return the names, and ports or 0, by which people reach the gateway, the one to print first. Raises BadInput."""
    names = [place_of(each, 0) for each in public]
    if host in WILDCARDS:
        names += [(own_address(host), 0)]
    elif not is_loopback(host):
        names += [(host, 0)]
    return [*names, ("127.0.0.1", 0), ("localhost", 0), *((("::1", 0),) if ":" in host else ())]


def _places(names: list[tuple[str, int]], bound: int, scheme: str) -> list[str]:
    """Return HOST:PORT of each name as browsers write it, the one to print first."""
    texts = []
    for name, port in names:
        port = port or bound
        whole = place_text(name, port)
        texts += [whole.rpartition(":")[0], whole] if port == USUAL_PORTS[scheme] else [whole]
    return texts
