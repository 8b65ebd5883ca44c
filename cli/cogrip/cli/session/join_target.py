"""Target of `cogrip join`: a join link or HOST:PORT as it was typed, and the hello for it."""

import re
import secrets
import sys
from collections.abc import Callable
from dataclasses import dataclass, field

from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.client.io.paths import JoinError, Paths, Server, find
from cogrip.devices.device import Capability
from cogrip.protocol.secure.channel import Channel, UnencryptedChannel
from cogrip.protocol.version import VERSION
from cogrip.protocol.wire.join_link import (
    DEFAULT_PORT,
    LinkError,
    is_link,
    is_secret,
    parse_link,
    split_place,
    unwrapped,
)
from cogrip.protocol.wire.messages import MAX_MESSAGE_BYTES, Hello, padded
from cogrip.protocol.wire.session import make_hello


@dataclass(frozen=True, slots=True)
class JoinTarget:
    """Server, room, seat and settings to ask for. fingerprint: of the server's certificate, "" for unencrypted sessions."""

    host: str
    port: int
    room: str
    fingerprint: str = ""
    token: str = field(default="", repr=False)
    name: str = ""
    digest: str = ""

    @property
    def channel(self) -> Callable[[], Channel]:
        """Factory of channels to the server."""
        if not self.fingerprint:
            return UnencryptedChannel
        from cogrip.protocol.io.dtls_client import DtlsClient  # OpenSSL takes a while

        return lambda: DtlsClient(self.fingerprint)

    def paths(self, insecure: bool) -> Paths:
        """Return the paths to the server. Raises Problem for an unknown name, or for an unencrypted session elsewhere."""
        with Problem.of(JoinError):
            found: Server = find(self.host, self.port)
        if not self.fingerprint and not insecure and not found.loopback:
            raise Problem(
                f"{self.host} is not this machine, and without encryption everyone on the path could read the session and "
                "move your hand: use the join link that the server printed (cogrip://...); --insecure does without it"
            )
        return Paths(found, self.channel, bool(self.fingerprint) or insecure)

    def player(self, record: Capability, address: str) -> Hello:
        """Return the hello of a player with the device at `address`."""
        return _fitting(make_hello(
            software=VERSION, nonce=_nonce(), room=self.room, name=self.name, digest=self.digest, device=address,
            token=self.token, **record.claims,
        ))  # fmt: skip

    def observer(self) -> Hello:
        """Return the hello of an observer."""
        return _fitting(make_hello(
            software=VERSION, nonce=_nonce(), room=self.room, name=self.name, digest=self.digest, device="none", axes=1,
            rate_hz=1.0, role="observer", token=self.token,
        ))  # fmt: skip


def _fitting(hello: Hello) -> Hello:
    """Return a hello that fits a message: beside a long token only names as a server has them do. Raises BadInput."""
    if (size := len(padded(hello))) > MAX_MESSAGE_BYTES:
        raise BadInput(
            f"room, name and token make a hello of {size} bytes, and {MAX_MESSAGE_BYTES} fit: names of rooms and seats have "
            "at most 40 letters, digits, blanks and . _ -"
        )
    return hello


def _nonce() -> int:
    return secrets.randbelow(2**62) + 1


def typed(server: str, more: tuple[str, ...]) -> str:
    """Return the text of the target; for - the first line of standard input. Raises BadInput, which shows no link."""
    if server.startswith("-") and server != "-":
        option = f" {server}" if re.fullmatch(r"--[a-z]+(-[a-z]+)?", server) and len(server) < 20 else ""
        raise BadInput(f"join: unknown option{option} before the server; `cogrip join --help` lists them")
    if more and (server, more[0]) == ("cogrip", "join"):  # copied with the command before it
        server, *rest = more[1:] or ("",)
        more = tuple(rest)
    if more:
        words = f"{len(more) + 1} words stand there"
        raise BadInput(f"join: one link or HOST:PORT is needed, and {words}: put the link in quotes")
    if server != "-":
        return unwrapped(server)
    if not (text := unwrapped(sys.stdin.readline() if sys.stdin else "")):
        raise BadInput("standard input has no join link in its first line; write the link there, or give it for the -")
    return text


def target_of(server: str, room: str, insecure: bool, name: str, digest: str) -> JoinTarget:
    """Return the target of a link or HOST:PORT. Raises BadInput, which shows nothing that may be secret."""
    link_meant = is_link(server)
    if not link_meant and is_secret(server):
        raise BadInput("server: this is the end of a join link: paste it whole, from cogrip:// on")
    try:
        if link_meant:
            link = parse_link(server)
            if insecure:
                raise BadInput("--insecure is for HOST:PORT; with a link everything is encrypted: leave it out")
            if room and link.room and room != link.room:
                raise BadInput(f"room {room!r} is asked for, and the link is for {link.room!r}: leave one of them out")
            return JoinTarget(link.host, link.port, room or link.room, link.fingerprint, link.token, name, digest)
        host, port = split_place(server)
    except LinkError as error:
        if link_meant:
            raise BadInput(str(error)) from None
        cure = f"write HOST:PORT, such as 127.0.0.1:{DEFAULT_PORT}, or the server's join link"
        raise BadInput(f"server {error}; {cure}") from None
    return JoinTarget(host, DEFAULT_PORT if port is None else port, room, name=name, digest=digest)
