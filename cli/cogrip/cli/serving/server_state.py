"""State folder of a server that starts: held, with its key and tokens; and the record and links that it publishes."""

import os
import secrets
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from cogrip.cli.serving.served_rooms import Say
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.join_link import JoinLink, LinkError, check_host
from cogrip.server.admission.tokens import TokenError
from cogrip.server.core import ServerCore
from cogrip.server.events import ServerEvent
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.published_state import PublishedState
from cogrip.server.io.state_folder import (
    BusyError,
    ServerRecord,
    StateError,
    StateFolder,
    locked,
    make_folder,
    one_server,
    share,
    state_path,
    write_server,
)  # fmt: skip
from cogrip.server.io.token_file import TokenFile
from cogrip.server.io.udp_socket import ServerChannel
from cogrip.server.rate_limit import RateLimiter, limits_for
from cogrip.server.unencrypted_channel import UnencryptedListener

if TYPE_CHECKING:  # OpenSSL takes a while
    from cogrip.server.io.dtls_channel import DtlsListener

KEY_LIMIT_S = 5.0
MOST_LINKED = 100  # most rooms that have links of their own: where there are more, one link is for any
WILDCARDS = ("0.0.0.0", "::", "")
LOOPBACKS = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # address by which a process of this machine reaches a wildcard


def held_folder(
    state: Path | None, port: int, encrypted: bool, warn: Callable[[str], None], stack: ExitStack
) -> StateFolder | None:
    """Return the folder, held until `stack` is left. An unencrypted server may run without one that is not asked for.

    warn: takes what is to be said of that once the server listens; where another server has the port, too, it never does.
    """
    path = state_path(state, port)
    if path is None:
        if encrypted:
            raise BadInput("serve: an encrypted server on --port 0 needs a folder for its key; name one with --state")
        return None
    try:
        folder = make_folder(path)
        stack.enter_context(one_server(folder))
    except StateError as error:
        if encrypted or state is not None:
            raise (Problem if isinstance(error, BusyError) else BadInput)(str(error)) from None
        warn(f"warning: nothing can be restored, and nobody kicked: {error}")
        return None
    return folder


def shared_folder(folder: StateFolder | None, shared: Path | None, encrypted: bool) -> StateFolder | None:
    """Return the folder with key, tokens and checkpoints in `shared`, where that is given. Raises BadInput."""
    with BadInput.of(StateError):
        found = None if folder is None else share(folder, shared)
        if found is not None and shared is not None and encrypted:
            from cogrip.protocol.io.certificate import CertificateError, load  # OpenSSL takes a while

            busy = f"{found.shared}: another front has been making its key for {KEY_LIMIT_S:g} s; end it, and try again"
            with locked(found.tokens_lock, busy, KEY_LIMIT_S), BadInput.of(CertificateError):
                load(found.shared)  # the key is made by one of several fronts that begin at once
        return found


def authenticator_of(folder: StateFolder | None, say: Say) -> TokenAuthenticator | None:
    """Return the authenticator by the folder's tokens, None without a folder. Raises BadInput."""
    if folder is None:
        return None
    from cogrip.protocol.io.certificate import CertificateError, load  # OpenSSL takes a while

    with BadInput.of(StateError, CertificateError):
        return TokenAuthenticator(TokenFile(folder), say, fingerprint=load(folder.shared).fingerprint)


def channel_of(core: ServerCore, folder: StateFolder | None) -> ServerChannel:
    """Return the server's channel, encrypted where there is a folder for the key. Raises BadInput, ServeError."""
    return _channel(core.listens_to, core.knows, [room.settings for room in core.rooms], folder)


def front_channel_of(
    asks: Callable[[Address], bool], rooms: Sequence[Settings], folder: StateFolder | None
) -> "UnencryptedListener | DtlsListener":
    """Return the channel of a front, which keeps nobody with a seat. asks: says whether an answer is awaited at an address."""
    return _channel(asks, lambda address: False, rooms, folder)


def _channel(
    listens: Callable[[Address], bool], seated: Callable[[Address], bool], rooms: Sequence[Settings],
    folder: StateFolder | None,
) -> "UnencryptedListener | DtlsListener":  # fmt: skip
    rate_hz = max(room.rates.network_hz for room in rooms)
    rate_limiter = RateLimiter(secrets.token_bytes(16), limits_for(rate_hz))
    if folder is None:
        return UnencryptedListener(rate_limiter, listens)
    from cogrip.protocol.io.certificate import CertificateError  # OpenSSL takes a while
    from cogrip.server.io.dtls_channel import DtlsListener

    with BadInput.of(CertificateError):  # no restart mends it: an administrator has to
        return DtlsListener(folder.shared, rate_limiter, seated)


def publish(
    folder: StateFolder, public: str | None, bound: tuple[str, int], rooms: Sequence[Settings], encrypted: bool,
    links: bool, say: Say, templates: Mapping[str, Sequence[Settings]] = MappingProxyType({}),
) -> tuple[str, PublishedState]:  # fmt: skip
    """Write the server's record for `cogrip token` and `cogrip kick`, and print the join links. Raises Problem.

    Returns an observer's link to the first room, "" for an unencrypted server; and what was published. A folder that takes
    nothing, as on a full disk, ends no server: it is said, and the state is written once it does.
    """
    host, port = public_place(public, bound)
    seats = {room.name: [user.name for user in room.users] for room in rooms}
    spare = {name: [user.name for user in each[0].users] for name, each in templates.items()}
    tell = lambda text: say(ServerEvent("trouble", text))  # noqa: E731
    if not encrypted:
        record = ServerRecord(host, port, "", seats, os.getpid(), spare)
        state = PublishedState(folder.server.name, lambda: write_server(folder, record), tell)
        state.write()
        state.report()
        return "", state
    with Problem.of(StateError, TokenError):
        from cogrip.protocol.io.certificate import load, secret_of

        fingerprint, secret = load(folder.shared).fingerprint, secret_of(folder.shared)
        record = ServerRecord(host, port, fingerprint, seats, os.getpid(), spare)
        linked = list(seats) if len(seats) <= MOST_LINKED else [""]
        tokens, now_s = TokenFile(folder), time.time()
        _, made = tokens.load().standing(secret, linked, now_s)
        kept = False

        def write() -> None:
            nonlocal kept
            write_server(folder, record)
            if not kept:  # once: a large book takes its time
                tokens.change(lambda book: book.standing(secret, linked, now_s))
                kept = True

        state = PublishedState(folder.server.name, write, tell)
        state.write()
        state.report()
    if links and public is None and bound[0] in WILDCARDS:
        say(f"links name {host}, which is a guess; --public HOST if people reach this machine by another name")
    for each in made if links else ():
        link = JoinLink(host, port, each.room, fingerprint, each.token)
        say(f"join {each.room or 'any room'} as {each.role}:  cogrip join '{link.text}'")
    if not made:  # rooms on demand alone
        return "", state
    observer = next(each for each in made if each.role == "observer")
    here = LOOPBACKS.get(bound[0], bound[0])
    return JoinLink(here, bound[1], observer.room, fingerprint, observer.token).text, state


def public_place(public: str | None, bound: tuple[str, int]) -> tuple[str, int]:
    """Return host and port by which people reach this server. Raises BadInput."""
    host, port = bound
    if public is None:
        return (own_address(host), port) if host in WILDCARDS else (host, port)
    return place_of(public, port)


def place_of(public: str, port: int) -> tuple[str, int]:
    """Return host and port of `--public`, `port` where it has none. Raises BadInput."""
    name, colon, number = public.rpartition(":")
    if not colon or (":" in name and not public.startswith("[")):  # a bare name or IPv6 address
        name, number = public, ""
    with BadInput.of(LinkError, where=f"--public {public}: "):
        check_host(name.strip("[]"))
    if not number and not public.endswith(":"):
        return name.strip("[]"), port
    if not number.isdigit() or not 0 < int(number) < 65536:
        raise BadInput(f"--public {public}: write HOST or HOST:PORT with a port from 1 to 65535")
    return name.strip("[]"), int(number)


def own_address(wildcard: str) -> str:
    """Return the address that this machine uses towards others; nothing is sent to find out."""
    family, far = (socket.AF_INET6, "2001:db8::1") if wildcard == "::" else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))
            return str(probe.getsockname()[0])
        except OSError:  # no route: then by name
            return socket.gethostname()
