"""`cogrip serve`: the shared object, for whoever joins."""

import os
import secrets
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from ipaddress import ip_address
from math import inf
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from cogrip.cli.runs.new_run import live_run_folder
from cogrip.cli.runs.run_files import leave_files
from cogrip.cli.session.before_run import together
from cogrip.cli.session.live_screen import LiveScreen, may_draw
from cogrip.cli.session.live_views import ServeView
from cogrip.cli.session.log_lines import LogLines
from cogrip.cli.session.settings_file import load as load_settings
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.devices.device import DeviceError
from cogrip.protocol.channel import place_text
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.join_link import DEFAULT_PORT, JoinLink, LinkError, check_host
from cogrip.protocol.settings import Settings, for_strangers, not_passive
from cogrip.protocol.version import VERSION
from cogrip.server.core import ServerCore
from cogrip.server.events import ServerEvent
from cogrip.server.io.authenticator import TokenAuthenticator
from cogrip.server.io.housekeeping import Housekeeping
from cogrip.server.io.metrics_feed import MetricsError, open_metrics
from cogrip.server.io.state_folder import (
    BusyError,
    ServerRecord,
    StateError,
    StateFolder,
    make_folder,
    one_server,
    state_path,
    write_server,
)
from cogrip.server.io.token_file import TokenFile
from cogrip.server.loop import HostError, LiveServer, ServeError, ServerChannel
from cogrip.server.rate_limit import RateLimiter, limits_for
from cogrip.server.unencrypted_channel import UnencryptedListener
from cogrip.sim.runs.folder import SERVER_RECORDING, write_settings
from cogrip.sim.runs.summary import of_room
from cogrip.sim.runs.verdict import came, succeeded

Say = Callable[[ServerEvent | str], None]
WILDCARDS = ("0.0.0.0", "::", "")


def serve(
    *config: Path,
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    seal: bool = False,
    insecure: bool = False,
    state: Path | None = None,
    fresh: Annotated[bool, Parameter(negative="")] = False,
    public: str | None = None,
    links: bool = True,
    log: Literal["text", "json"] = "text",
    metrics: int | None = None,
    overrides: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    seconds: float | None = None,
    runs: Path = Path("runs"),
    into: Path | None = None,
    report: bool = True,
    record: bool = True,
    quiet: Annotated[bool, Parameter(negative="")] = False,
) -> int:
    """Serve until Ctrl-C or SIGTERM; then say goodbye to everyone and leave a run folder.

    On loopback a session is plain, and whoever is on this machine may join. On any other address it is sealed: people come in
    by the links that are printed, or that `cogrip token new` makes. SIGHUP reads the tokens again.

    Parameters
    ----------
    config
        Settings files, or names of those that come with cogrip (`cogrip configs`), one for each room; a room is called by
        its `name`.
    host
        Address to listen on.
    port
        UDP port; 0 takes a free one.
    seal
        Seal on loopback as well.
    insecure
        Do not seal, whatever the address: anyone who can reach it may join, and may forge what moves a motor.
    state
        Folder for key, tokens, checkpoints; one of this user's for each port if not given (with --port 0: none).
    fresh
        Begin with every object at its start and every seat free, not where a server that was killed left them.
    public
        HOST or HOST:PORT by which people reach this server, for its links; guessed if not given.
    links
        Print a join link for each role and room. They let in whoever reads them: leave them out of a journal.
    log
        Lines for people, or one JSON object a line.
    metrics
        Port on loopback for /metrics (Prometheus) and /healthz; 0 takes a free one. None if not given.
    overrides
        Override a setting in every file: section.key=value. Repeatable.
    seconds
        Stop by yourself after so long.
    runs
        Folder in which the run folder is made; of several rooms each has a folder in it.
    into
        Write into this existing folder instead, and leave its report to its owner (one room only).
    report
        Write report.html and plots at the end.
    record
        Record the session; every replay, report and verification needs it.
    quiet
        Show no live table at a terminal, only lines.
    """
    rooms = _rooms(config, overrides, port, into)
    host = _host(host)
    lines = LogLines(log)
    say = lines.say
    sealed = not insecure and (seal or not _is_loopback(host))
    _check_flags(seal, insecure, sealed, public, metrics, seconds)
    if sealed:
        rooms = [for_strangers(room) for room in rooms]
    names = [room.name for room in rooms]
    stop = Stop()
    with ExitStack() as stack:
        folder = _state_folder(state, port, sealed, say, stack)
        authenticator = _authenticator(folder, say) if sealed and folder else None
        server = LiveServer(
            rooms, host, port, stop, say, lambda core: _channel(core, folder if sealed else None), seconds=seconds
        )
        if authenticator is not None:
            server.authenticator = authenticator
        bound = _listen(server)
        run_folder = into or live_run_folder(runs, names[0] if len(names) == 1 else "rooms", say)
        folders: dict[str, Path] = {}
        if run_folder is not None:
            server.record_at = run_folder / SERVER_RECORDING if record else None
            folders = {name: run_folder if len(names) == 1 else run_folder / name for name in names}
            _write_settings(rooms, folders, run_folder, say)
        try:
            feed = None if metrics is None else open_metrics(metrics, say)
            housekeeping = Housekeeping(
                server, say, folder=folder, authenticator=authenticator, metrics=feed, software=VERSION, fresh=fresh
            )
        except (MetricsError, StateError) as error:
            server.close()
            raise Problem(str(error)) from None
        with on_signals(stop, hangup="reload"):
            _warn_of(rooms, bound, sealed, say)
            if folder is not None:
                _tell_commands(folder, public, bound, rooms, sealed, links, say)
            if feed is not None:
                say(f"metrics: http://127.0.0.1:{feed.port}/metrics, health: http://127.0.0.1:{feed.port}/healthz")
            housekeeping.begin()
            how = "sealed" if sealed else "plain"
            say(f"listening on {place_text(bound)}, {how}; rooms: {', '.join(names)}; Ctrl-C ends")
            screen = stack.enter_context(LiveScreen(say))
            if not quiet:
                _draw(screen, lines, rooms, run_folder if record else None, folder)
            try:
                server.run()
            finally:
                screen.close()
                housekeeping.end(said_goodbye=bool(stop.reason))
            say(stop.reason)
            losses = {**server.drops(), **server.losses(), **housekeeping.counts()}
            return _conclude(server, folders, losses, lines, alone=into is None, report=report)


def _draw(
    screen: LiveScreen, lines: LogLines, rooms: Sequence[Settings], recorded: Path | None, state: StateFolder | None
) -> None:
    """Show the rooms below the lines, at a terminal where people read them."""
    if lines.form != "text" or not may_draw(make_console()):
        return
    if recorded is None:
        lines.say("no live table without a recording")
        return
    lines.above = screen.passed
    seats = {room.name: tuple(user.name for user in room.users) for room in rooms}
    screen.draw(ServeView(str(recorded), seats, str(state.path) if state else ""))


def _check_flags(
    seal: bool, insecure: bool, sealed: bool, public: str | None, metrics: int | None, seconds: float | None
) -> None:
    """Raises BadInput for flags that exclude each other, do nothing, or are out of bounds."""
    if seal and insecure:
        raise BadInput("--seal and --insecure exclude each other; leave one out")
    if public is not None and not sealed:
        raise BadInput("--public is for the links of a sealed server: add --host ADDRESS or --seal, or leave it out")
    if metrics is not None and not 0 <= metrics <= 65535:
        raise BadInput(f"--metrics {metrics} is outside 0 to 65535")
    if seconds is not None and not 0.0 < seconds < inf:
        raise BadInput(f"--seconds {seconds:g} is no time to serve: give more than 0, or leave it out")


def _listen(server: LiveServer) -> tuple[str, int]:
    try:
        return server.listen()
    except HostError as error:
        raise BadInput(str(error)) from None
    except ServeError as error:
        raise Problem(str(error)) from None


def _warn_of(rooms: Sequence[Settings], bound: tuple[str, int], sealed: bool, say: Say) -> None:
    """Say what is dangerous, unstable or not bounded, before anyone comes."""
    if not sealed and not ip_address(bound[0].partition("%")[0]).is_loopback:
        say(
            f"warning: {bound[0]} is open to whoever can reach it, and sessions are not sealed (--insecure): "
            "anyone may join, listen, and forge what moves a motor"
        )
    open_to_others = sealed or not ip_address(bound[0].partition("%")[0]).is_loopback
    for settings in rooms:
        if open_to_others and (active := not_passive(settings)):
            say(
                f"warning: room {settings.name} is not passive ({active}): it can make energy, and throw about what people "
                "hold; serve people you trust, or leave these settings out"
            )
        if sealed and settings.coupling.kind == "coupling":
            say(
                f"warning: room {settings.name}: virtual coupling bounds speeds but no power: "
                "serve people you trust, or waves"
            )
        _warn(settings, say)


def _conclude(
    server: LiveServer, folders: dict[str, Path], losses: dict[str, int], lines: LogLines, *, alone: bool, report: bool
) -> int:
    """Leave a summary for each room; beside a log for programs it is told on standard error. Returns the exit code."""
    programs = lines.form == "json"
    console = make_console(soft_wrap=True, stderr=programs)
    if lines.lost:
        losses["log line"] = lines.lost
    well = True
    for room in server.core.rooms:
        summary = of_room(room, server.elapsed_s, losses)
        well = well and (succeeded(summary) or not came(summary))
        leave_files(folders.get(room.name), summary, console, shown=alone and not programs, report=alone and report)
    return 0 if well else 1


def _rooms(config: Sequence[Path], overrides: Sequence[str], port: int, into: Path | None) -> list[Settings]:
    if not config:
        raise BadInput(
            "serve: name at least one settings file, or one that comes with cogrip (`cogrip configs`), such as demo"
        )
    if not 0 <= port <= 65535:
        raise BadInput(f"--port {port} is outside 0 to 65535")
    rooms = [load_settings(path, overrides) for path in config]
    for path, room in zip(config, rooms, strict=True):
        if kept := room.link.kept_back:
            raise BadInput(
                f"{path}: {kept[0]}: no welcome carries it, so that nobody's client would emulate it: put `cogrip relay` with "
                "this file between, and leave [link] out of the one that is served; `cogrip lab` takes it as it is"
            )
    names = [room.name for room in rooms]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"serve: two rooms are called {name!r}; give each file a `name` of its own")
    if into is not None and len(rooms) > 1:
        raise BadInput("serve: --into takes one room; leave it out to get a folder")
    return rooms


def _host(host: str) -> str:
    """The address to listen on, an IPv6 one without its brackets."""
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    name, colon, port = bare.rpartition(":")
    if not bare or (colon and port.isdigit() and ":" not in name):
        raise BadInput(f"--host {host!r}: give an address of this machine alone; the port goes after --port")
    return bare


def _is_loopback(host: str) -> bool:
    """Whether nobody beyond this machine can reach `host`; a name that cannot be resolved is told of by `listen`."""
    try:
        found = socket.getaddrinfo(host or None, 0, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
    except OSError:
        return False
    return all(ip_address(str(each[4][0]).partition("%")[0]).is_loopback for each in found)


def _state_folder(state: Path | None, port: int, sealed: bool, say: Say, stack: ExitStack) -> StateFolder | None:
    """The folder, held until `stack` is left. A plain server goes on without one where it is not asked for."""
    path = state_path(state, port)
    if path is None:
        if sealed:
            raise BadInput("serve: a sealed server on --port 0 needs a folder for its key; name one with --state")
        return None
    try:
        folder = make_folder(path)
        stack.enter_context(one_server(folder))
    except StateError as error:
        if sealed or state is not None:
            raise (Problem if isinstance(error, BusyError) else BadInput)(str(error)) from None
        say(f"warning: nothing can be restored, and nobody kicked: {error}")
        return None
    return folder


def _authenticator(folder: StateFolder, say: Say) -> TokenAuthenticator:
    try:
        return TokenAuthenticator(TokenFile(folder), say)
    except StateError as error:
        raise BadInput(str(error)) from None


def _channel(core: ServerCore, folder: StateFolder | None) -> ServerChannel:
    """Sealed where there is a folder for the key. Raises ServeError."""
    rate_limiter = RateLimiter(
        secrets.token_bytes(16), limits_for(max(room.settings.rates.network_hz for room in core.rooms))
    )
    if folder is None:
        return UnencryptedListener(rate_limiter, core.listens_to)
    from cogrip.protocol.io.certificate import CertificateError  # OpenSSL takes a while
    from cogrip.server.io.dtls_channel import DtlsListener

    try:
        return DtlsListener(folder.path, rate_limiter, core.knows)
    except CertificateError as error:  # it will be as bad the next time: a person has to see to it
        raise BadInput(str(error)) from None


def _write_settings(rooms: Sequence[Settings], folders: dict[str, Path], run_folder: Path, say: Say) -> None:
    try:
        for settings in rooms:
            write_settings(folders[settings.name], settings)
    except OSError as error:  # the session goes on; whether it can be recorded is said on its own
        say(f"warning: {run_folder}: {error.strerror}; no settings are left there")


def _tell_commands(
    folder: StateFolder, public: str | None, bound: tuple[str, int], rooms: Sequence[Settings], sealed: bool, links: bool,
    say: Say,
) -> None:  # fmt: skip
    """Leave for `cogrip token` and `cogrip kick` what they need to know; print the links."""
    host, port = _public(public, bound)
    seats = {room.name: [user.name for user in room.users] for room in rooms}
    try:
        if not sealed:
            write_server(folder, ServerRecord(host, port, "", seats, os.getpid()))
            return
        from cogrip.protocol.io.certificate import load, secret_of

        fingerprint, secret = load(folder.path).fingerprint, secret_of(folder.path)
        write_server(folder, ServerRecord(host, port, fingerprint, seats, os.getpid()))
        made = TokenFile(folder).change(lambda book: book.standing(secret, list(seats), time.time()))
    except StateError as error:
        raise Problem(str(error)) from None
    if links and public is None and bound[0] in WILDCARDS:
        say(f"links name {host}, which is a guess; --public HOST if people reach this machine by another name")
    for each in made if links else ():
        link = JoinLink(host, port, each.room, fingerprint, each.token)
        say(f"join {each.room} as {each.role}:  cogrip join '{link.text}'")


def _public(public: str | None, bound: tuple[str, int]) -> tuple[str, int]:
    """How people reach this server."""
    host, port = bound
    if public is not None:
        name, colon, number = public.rpartition(":")
        if not colon or (":" in name and not public.startswith("[")):  # a bare name or IPv6 address
            name, number = public, str(port)
        try:
            check_host(name.strip("[]"))
        except LinkError as error:
            raise BadInput(f"--public {public}: {error}") from None
        if not number.isdigit() or not 0 < int(number) < 65536:
            raise BadInput(f"--public {public}: write HOST or HOST:PORT with a port from 1 to 65535")
        return name.strip("[]"), int(number)
    return (_own_address(host), port) if host in WILDCARDS else (host, port)


def _own_address(wildcard: str) -> str:
    """The address that this machine uses towards others; nothing is sent to find out."""
    family, far = (socket.AF_INET6, "2001:db8::1") if wildcard == "::" else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))
            return str(probe.getsockname()[0])
        except OSError:  # no way out: then by name
            return socket.gethostname()


def _warn(settings: Settings, say: Say) -> None:
    """Say where a room lies outside what is stable, passive or fit for its devices, in the words of `cogrip advise`."""
    from cogrip.sim.analysis.advice import advise
    from cogrip.sim.analysis.linear_session import ModelError

    try:
        warnings = advise(settings).warnings
    except (ModelError, DeviceError) as error:
        warnings = (f"no advice: {error}",)
    for text in together(warnings, [user.name for user in settings.users]):
        say(f"warning: room {settings.name}: {text}")
