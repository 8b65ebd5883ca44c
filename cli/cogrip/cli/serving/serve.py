"""`cogrip serve`: the shared object, for everyone who joins."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from cogrip.cli.serving.here import ServerHere
from cogrip.cli.serving.kept_runs import Keeping
from cogrip.cli.serving.log_lines import LogLines
from cogrip.cli.serving.served_rooms import Say, Workers, rooms_of, spare_rooms, warn_of, worker_count
from cogrip.cli.serving.server_state import LOOPBACKS, authenticator_of, held_folder, publish, shared_folder
from cogrip.cli.session.loopback import is_loopback
from cogrip.cli.session.network_rate import RateChoices, measured
from cogrip.cli.session.python_worlds import PythonWorlds, allow_python_worlds
from cogrip.cli.session.trigger_line import open_trigger, trigger_codes
from cogrip.cli.session.view_child import ViewChild
from cogrip.cli.terminal.parameters import Overrides, Quiet, Record, Report
from cogrip.cli.terminal.problem import BadInput, Problem, some_time, within
from cogrip.machine.platform import system
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.room import for_remote_clients
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.texts import named
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.protocol.wire.messages import MOST_WAIT_MS
from cogrip.server.hosting.placement import Placement, Served
from cogrip.server.io.loop import FLOOR_BYTES
from cogrip.server.io.metrics_feed import MetricsError, MetricsFeed, open_metrics
from cogrip.server.io.rooms_on_demand import EMPTY_S
from cogrip.server.io.run_retention import GB
from cogrip.server.io.state_folder import StateFolder, state_path


def serve(
    *config: Path,
    host: str = "127.0.0.1",
    port: int = DEFAULT_PORT,
    encrypted: Annotated[bool, Parameter(name=["--encrypted", "--seal"])] = False,
    insecure: bool = False,
    state: Path | None = None,
    fresh: Annotated[bool, Parameter(negative="")] = False,
    public: str | None = None,
    view: Annotated[bool, Parameter(negative="")] = False,
    links: bool = True,
    log: Literal["text", "json"] = "text",
    metrics: int | None = None,
    trigger: str | None = None,
    trigger_code: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    hand_over: float | None = None,
    overrides: Overrides = (),
    seconds: float | None = None,
    runs: Path = Path("runs"),
    into: Path | None = None,
    report: Report = True,
    record: Record = True,
    keep_days: float | None = None,
    keep_gb: float | None = None,
    free_gb: float = FLOOR_BYTES / GB,
    quiet: Quiet = False,
    python_worlds: PythonWorlds = (),
    workers: Workers = 1,
    template: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    empty_after: float = EMPTY_S,
    cluster: str | None = None,
    shared: Path | None = None,
    room_ports: str | None = None,
    checkpoints: Literal["folder", "memory"] = "folder",
) -> int:
    """Serve until Ctrl-C or SIGTERM; then say goodbye to everyone and leave a run folder.

    On loopback a session is unencrypted, and every user of this machine may join. On any other address it is encrypted, and
    people join by the links that are printed, or that `cogrip token new` makes. SIGHUP reads the tokens again.

    Parameters
    ----------
    config
        Settings files, or names of those that come with cogrip (`cogrip configs`), one for each room; a room is called by
        its `name`.
    host
        Address to listen on.
    port
        UDP port; 0 takes a free one.
    encrypted
        Encrypt on loopback as well. `--seal` is its earlier name.
    insecure
        Do not encrypt, whatever the address: anyone who can reach it may join, and may forge what moves a motor.
    state
        Folder for key, tokens, checkpoints; one of this user's for each port if not given (with --port 0: none).
    fresh
        Begin with every object at its start and every seat free, not from the checkpoint of a server that was killed.
    public
        HOST or HOST:PORT by which people reach this server, for its links; guessed if not given.
    view
        Show the first room in the browser as well.
    links
        Print a join link for each role and room. Whoever reads them may join: leave them out of a journal.
    log
        Lines for people, or one JSON object a line.
    metrics
        Port on loopback for /metrics (Prometheus) and /healthz; 0 takes a free one. None if not given.
    trigger
        Raise a line of a serial port, or send a byte on it, at every marker: rts:PORT, dtr:PORT or byte:PORT.
    trigger_code
        TEXT=CODE, repeatable: the byte of the marker of these words, 1 to 255, * for all others; markers without a code are not
        sent. With none given, all are, by codes in turn.
    hand_over
        At SIGTERM keep the seats for the next start: people let go, and wait so many seconds for it. None if not given.
    seconds
        Stop after this time.
    runs
        Folder in which the run folder is made; with several rooms each has a folder in it.
    keep_days
        Remove runs of servers in the folder of --runs so many days after their end; none if not given.
    keep_gb
        Remove the oldest finished ones of them while all together are larger; none if not given.
    free_gb
        Stop recording, the file whole, where less is free on the disk; 0 for never.
    into
        Write into this existing folder instead, and leave its report to its owner (one room only).
    workers
        Processes over which the rooms are divided, behind one port; auto: one less than there are cores. Linux only.
    cluster
        Serve the rooms on the hosts of a Ray cluster, this one being a front: ray, or ray://HOST:PORT of its head. Linux only.
    shared
        Folder that all hosts of the cluster reach, for key, tokens and checkpoints, in place of the state folder.
    room_ports
        UDP ports of the rooms of a cluster, FIRST-LAST, for a firewall; any if not given.
    template
        FILE:COUNT, repeatable: at most so many rooms of this settings file, opened on demand by `cogrip room new`.
    empty_after
        Seconds after which a room on demand that is empty is closed.
    checkpoints
        Where those of a cluster are: in the shared folder, or in the memory of two of its hosts.
    """
    allow_python_worlds(python_worlds)
    rates = RateChoices(measured, None if fresh else state_path(state, port))
    rooms = rooms_of(config, overrides, port, into, rates, bool(template))
    spare = spare_rooms(template, overrides, rates)
    within("--empty-after", empty_after, 1.0, 1e6)
    _check_names(rooms, spare)
    standing = rooms or [next(iter(spare.values()))[0]]
    rooms = [*rooms, *(room for each in spare.values() for room in each)]
    host = _host(host)
    lines = LogLines(log)
    say = lines.say
    for text in rates.lines():
        say(text)
    encrypted = _encrypted(encrypted, insecure, host)
    _check_flags(encrypted, public, metrics, seconds)
    keeping = Keeping(runs, keep_days, keep_gb, free_gb, into)
    keeping.check()
    if encrypted:
        rooms = [for_remote_clients(room) for room in rooms]
    if spare and cluster is not None:
        raise BadInput(
            "--template is for rooms of one host: leave --cluster out; docs/scaling.md has fleets of servers"
        )
    count = worker_count(workers, len(rooms))
    if count > 1 and trigger is not None:
        raise BadInput("--trigger is for one process: leave --workers out, or serve its room by another server")
    one_host = {
        "--workers": workers != 1,
        "--trigger": trigger is not None,
        "--view": view,
        "--fresh": fresh,
        "--hand-over": hand_over is not None,
        **keeping.given,
        "--into": into is not None,
    }
    shared_flags = {"--shared": shared, "--room-ports": room_ports, "--checkpoints": checkpoints != "folder"}
    head = _head(cluster, one_host, shared_flags)
    codes = trigger_codes(trigger, trigger_code)
    stop = Stop()
    with ExitStack() as stack:
        line = open_trigger(trigger, stack, codes)
        warnings: list[str] = []
        folder = held_folder(state, port, encrypted, warnings.append, stack)
        _check_hand_over(hand_over, folder)
        folder = shared_folder(folder, shared, encrypted)
        authenticator = authenticator_of(folder if encrypted else None, say)
        names = {name: [room.name for room in each] for name, each in spare.items()}
        served = Served(
            rooms, host, port, folder, authenticator, encrypted, record, report, rates.found, names, empty_after
        )
        shown = [*served.standing, *(each[0] for each in spare.values())]  # one of each template
        placement: Placement
        if head is not None:
            from cogrip.cli.serving.cluster import ClusterFlags, ClusterServer, udp_range_of  # with OpenSSL

            flags = ClusterFlags(head, public, udp_range_of(room_ports), checkpoints == "memory", runs)
            placement = ClusterServer(served, flags, stop, lines, stack)
        elif count > 1:
            from cogrip.cli.serving.workers import WorkerServer  # with OpenSSL

            placement = WorkerServer(served, count, keeping, fresh, hand_over, stop, lines, stack)
        else:
            placement = ServerHere(served, keeping, fresh, hand_over, line, quiet, stop, lines, stack)
        for text in warnings:
            say(text)
        with Problem.of(MetricsError):
            feed = None if metrics is None else open_metrics(metrics, say)
        with on_signals(stop, hangup="reload"):
            chores = placement.begin(feed, warn_of(shown, placement.bound, encrypted, say))
            link = ""
            if folder:
                link, chores.published = publish(
                    folder,
                    public,
                    placement.bound,
                    served.standing,
                    encrypted,
                    links,
                    say,
                    spare,
                )
            chores.more_degraded = lambda: keeping.degraded(record)
            chores.begin()
            _say_where(placement.bound, encrypted, [room.name for room in served.standing], feed, say)
            for name, each in spare.items():
                say(f"{len(each)} rooms on demand of template {name}: cogrip room new {name}")
            if view:
                _view(placement.bound, link, standing[0].name, insecure, say, stack)
            return placement.run(seconds)


def _check_names(rooms: Sequence[Settings], spare: Mapping[str, Sequence[Settings]]) -> None:
    """Raise BadInput where a room has the name of a template, or of one of its rooms."""
    taken = {*spare, *(room.name for each in spare.values() for room in each)}
    if twice := [room.name for room in rooms if room.name in taken]:
        raise BadInput(f"serve: {twice[0]!r} is a room and a template; give each file a `name` of its own")


def _head(cluster: str | None, one_host: dict[str, bool], for_cluster: Mapping[str, object]) -> str | None:
    """Return the address of the cluster's head, None without a cluster. Raises BadInput.

    one_host, for_cluster: flags that are for a server on one host, or for a cluster, and whether they are given
    """
    if cluster is None:
        if wrong := [flag for flag, given in for_cluster.items() if given]:
            raise BadInput(f"{wrong[0]} is for the hosts of a cluster: add --cluster ray, or leave it out")
        return None
    from cogrip.cli.serving.cluster import head_of

    if not system.LINUX:
        raise BadInput("--cluster needs Linux on every host; leave it out")
    if wrong := [flag for flag, given in one_host.items() if given]:
        raise BadInput(f"{wrong[0]} is for a server on one host: leave it out, or leave --cluster out")
    return head_of(cluster)


def _say_where(
    bound: tuple[str, int], encrypted: bool, names: Sequence[str], feed: MetricsFeed | None, say: Say
) -> None:
    """Say where people and programs find this server."""
    if feed is not None:
        say(f"metrics: http://127.0.0.1:{feed.port}/metrics, health: http://127.0.0.1:{feed.port}/healthz")
    how, rooms = "encrypted" if encrypted else "unencrypted", named(names) if names else "none yet"
    say(f"listening on {place_text(bound)}, {how}; rooms: {rooms}; Ctrl-C ends")


def _view(bound: tuple[str, int], link: str, room: str, insecure: bool, say: Say, stack: ExitStack) -> None:
    """Show a room in the browser until `stack` is left."""
    shown = place_text((LOOPBACKS.get(bound[0], bound[0]), bound[1]))
    stack.enter_context(ViewChild(link or shown, say, room, insecure=insecure, waits=False))


def _encrypted(asked: bool, insecure: bool, host: str) -> bool:
    """Return whether sessions are encrypted. Raises BadInput."""
    if asked and insecure:
        raise BadInput("--encrypted and --insecure exclude each other; leave one out")
    return asked or not (insecure or is_loopback(host))


def _check_hand_over(wait_s: float | None, folder: StateFolder | None) -> None:
    """Raise BadInput where nothing can be handed over."""
    if wait_s is not None:
        within("--hand-over", wait_s, 0.0, MOST_WAIT_MS / 1000)
        if folder is None:
            raise BadInput("--hand-over: the next start goes on by checkpoints; name a folder for them with --state")


def _check_flags(encrypted: bool, public: str | None, metrics: int | None, seconds: float | None) -> None:
    """Raise BadInput for flags that have no effect, or are out of bounds."""
    if public is not None and not encrypted:
        raise BadInput(
            "--public is for the links of an encrypted server: add --host ADDRESS or --encrypted, or leave it out"
        )
    if metrics is not None:
        within("--metrics", metrics, 0, 65535)
    some_time(seconds, "serve")


def _host(host: str) -> str:
    """Return the address to listen on, an IPv6 one without its brackets. Raises BadInput."""
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    name, colon, port = bare.rpartition(":")
    if not bare or (colon and port.isdigit() and ":" not in name):
        raise BadInput(f"--host {host!r}: give an address of this machine alone; the port goes after --port")
    return bare
