"""`cogrip relay`: an emulated network between any two programs that speak UDP."""

import sys
from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from pathlib import Path
from typing import Any, Literal

import msgspec
from rich.console import Console
from rich.table import Table

from cogrip.cli.serving.log_lines import LogLines
from cogrip.cli.settings.settings_file import from_flags, load
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.parameters import Overrides
from cogrip.cli.terminal.problem import BadInput, Problem, some_time, within
from cogrip.cli.terminal.tables import Fitted, plain_table, wrapped
from cogrip.cli.terminal.tables import say as say_lines
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.settings.link_profile import Direction, Link
from cogrip.protocol.settings.network_profiles import ProfileName
from cogrip.protocol.wire.join_link import DEFAULT_PORT, LinkError, split_place
from cogrip.sim.delay_trace import TraceError, read_trace
from cogrip.sim.io.relay_loop import LiveRelay, PlaceError, RelayError
from cogrip.sim.link import LinkEmulator, configured_link
from cogrip.sim.outages import ScriptError, read_script
from cogrip.sim.relay import Relay

RELAY_PORT = DEFAULT_PORT + 1
DIRECTIONS: tuple[Direction, Direction] = ("up", "down")
PIPED_WIDTH = 300  # width at which a file has all columns in one table
MOST_FLOWS = 400  # most flows: `select` takes sockets up to number 1023
NOTHING = "adds nothing"
CLEAR = "\r\x1b[K"
OUTCOMES = ("delivered", "lost", "outage", "queue_dropped", "duplicated", "held", "reordered", "in_flight")
TROUBLES = ("crowded", "not_sent", "refused")


def relay(
    config: Path | None = None,
    /,
    *,
    to: str,
    listen: str = f"127.0.0.1:{RELAY_PORT}",
    profile: ProfileName | None = None,
    overrides: Overrides = (),
    seed: int | None = None,
    up_trace: Path | None = None,
    down_trace: Path | None = None,
    outages: Path | None = None,
    flows: int = 64,
    idle_s: float = 60.0,
    seconds: float | None = None,
    json: Json = None,
) -> int:
    """Put an emulated network between any two programs that speak UDP.

    Datagrams are relayed between clients and a server until Ctrl-C or SIGTERM, and never read, so that encrypted sessions and
    other programs can be tested as well. Every client address has a path of its own to the server, numbered in order of
    arrival, from 0: path n has the conditions of seat n in `cogrip lab`.

    Parameters
    ----------
    config
        Settings file, or a name (`cogrip configs`); its [link] and seed are taken.
    to
        The server: HOST:PORT, or HOST for the usual port.
    listen
        Where to receive from clients: HOST:PORT of this machine; 0.0.0.0 is all of its addresses.
    profile
        A network profile by name, as link.profile; `docs/networks.md` describes each.
    seed
        Seed of all randomness; else the settings file's, else 1.
    up_trace
        Recorded delays from clients to server: CSV with t_s,delay_ms. As link.up.trace.
    down_trace
        Recorded delays from server to clients. As link.down.trace.
    outages
        Script of outages: CSV with start_s,length_s and optionally way; from the first datagram on.
    flows
        Most clients at once; further ones are not relayed.
    idle_s
        Time of silence after which a flow ends.
    seconds
        Stop after this time.
    """
    link, seed = _link(config, overrides, profile, seed, {"up": up_trace, "down": down_trace})
    script: Mapping[Direction, Sequence[tuple[float, float]]] = {"up": (), "down": ()}
    if outages is not None:
        with BadInput.of(ScriptError, where="--outages "):
            script = read_script(outages)
    within("--flows", flows, 1, MOST_FLOWS)
    within("--idle-s", idle_s, 1, 1_000_000)
    some_time(seconds, "relay")

    def make_link(number: int, direction: Direction, origin_ns: int) -> LinkEmulator:
        return configured_link(link, direction, f"{seed}/{number}/{direction}", script[direction], origin_ns)

    console = make_console(soft_wrap=True, stderr=json == "-", piped_width=PIPED_WIDTH)
    lines = LogLines(stream=sys.stderr if json == "-" else sys.stdout)
    stop = Stop()

    def say(text: str) -> None:
        """Say it, wrapped, in place of the status on a terminal."""
        if console.is_terminal:
            lines.put(CLEAR)
        for line in wrapped(text, console).split("\n"):
            lines.say(line)

    core, near, far = Relay(make_link, flows, round(idle_s * 1e9)), _place("--listen", listen), _place("--to", to)
    live = LiveRelay(core, near, far, stop, say, seconds=seconds)
    if console.is_terminal:
        live.each_second = lambda now_ns: lines.put(status(live, console.size.width))
    with on_signals(stop):
        with Problem.of(RelayError), BadInput.of(PlaceError):
            live.open()
        _say_network(link, script, say)
        say(f"relaying from {place_text(live.bound)} to {place_text(live.far)}; seed {seed}; Ctrl-C ends")
        live.run()
    if lines.lost:
        live.counts["log line"] = lines.lost
    if console.is_terminal:
        lines.put("\n")
    ending = StringIO()  # put with the lines, since it may have no reader either
    end = make_console(file=ending, width=console.width, force_terminal=console.is_terminal, soft_wrap=True)
    end.print(f"ended: {stop.reason}")
    end.print(flows_table(live))
    _print_counts(live, end)
    lines.put(ending.getvalue(), wait=True)
    if json is not None:
        write_json({"profile": link.profile, "seed": seed, "link": _described(link), **_summary(live)}, json)
    return 0


def _link(
    config: Path | None,
    overrides: Sequence[str],
    profile: str | None,
    seed: int | None,
    traces: Mapping[Direction, Path | None],
) -> tuple[Link, int]:
    """Return [link] and seed of a settings file, if there is one, overridden by the flags. Raises BadInput."""
    for text in overrides:
        if not text.strip().startswith("link."):
            raise BadInput(f"--set {text}: the relay takes keys of [link] only, such as link.delay_ms=30")
    if config is not None and profile is not None:
        raise BadInput("--profile and a settings file exclude each other; add --set link.profile=NAME for both")
    flags = []
    for direction, path in traces.items():
        if path is None:
            continue
        with BadInput.of(TraceError, where=f"--{direction}-trace "):
            read_trace(path)
        flags.append(f"link.{direction}.trace={msgspec.json.encode(str(path)).decode()}")  # as a TOML string
    if profile is not None:
        flags.insert(0, f"link.profile={profile}")
    if seed is not None:
        flags.append(f"seed={seed}")
    given, names = [*flags, *overrides], {"link.profile": "--profile", "seed": "--seed"}
    settings = load(config, given, world=False, flags=names) if config else from_flags(given, names)
    return settings.link, settings.seed


def _place(flag: Literal["--listen", "--to"], text: str) -> tuple[str, int]:
    """Return host and port of HOST:PORT. Raises BadInput."""
    port = RELAY_PORT if flag == "--listen" else DEFAULT_PORT
    if flag == "--listen" and text.endswith(":0"):  # a free one
        text, port = text[:-2], 0
    try:
        host, given = split_place(text)
    except LinkError as error:
        raise BadInput(f"{flag} {error}; write HOST:PORT, such as 127.0.0.1:{port or RELAY_PORT}") from None
    return host, port if given is None else given


def _described(link: Link) -> dict[str, Any]:
    return {
        direction: {**msgspec.structs.asdict(link.direction(direction)), "trace": link.trace_of(direction)}
        for direction in DIRECTIONS
    }


def _say_network(link: Link, script: Mapping[Direction, Sequence[Any]], say: Callable[[str], None]) -> None:
    words = [_words(link, direction, len(script[direction])) for direction in DIRECTIONS]
    for direction, text in zip(DIRECTIONS, words, strict=True):
        say(f"{direction}: {text}")
    if set(words) == {NOTHING}:
        say("no network is emulated: give --profile NAME, --set link.KEY=VALUE or a settings file")


def _words(link: Link, direction: Direction, scripted: int) -> str:
    """Return what a direction does to datagrams, in few words."""
    profile = link.direction(direction)
    words = [f"{profile.delay_ms:g} ms"] if profile.delay_ms else []
    if profile.jitter_ms:
        words.append(f"jitter {profile.jitter_ms:g} ms")
    if profile.loss:
        words.append(f"loss {100 * profile.loss:g} % in runs of {profile.burst_frames:g}")
    shares = {name: getattr(profile, name) for name in ("duplicate", "reorder")}
    words += [f"{name} {100 * share:g} %" for name, share in shares.items() if share]
    if profile.rate_kbps:
        words.append(f"{profile.rate_kbps:g} kbit/s")
    if profile.outage_s:
        words.append(f"outage of {profile.outage_s:g} s every {profile.outage_every_s:g} s")
    if scripted := scripted + len(link.script(direction)):
        words.append(f"{scripted} outage{'s' if scripted > 1 else ''} by script")
    if trace := link.trace_of(direction):
        words.append(f"trace {trace}")
    return ", ".join(words) or NOTHING


def status(live: LiveRelay, width: int) -> str:
    """Return a line that overwrites the last, shorter on a narrow terminal: a table would take as long as several datagrams."""
    totals = {direction: live.relay.totals(direction) for direction in DIRECTIONS}
    begin = f"{live.elapsed_s:.0f} s, {len(live.relay.flows)} flows: "
    line = begin
    forms = ("{sent} in, {delivered} out, {lost} lost, {outage} in outages", "{sent} in, {delivered} out", "{sent} in")
    for form in forms:
        line = begin + "; ".join(f"{direction} {form.format(**total)}" for direction, total in totals.items())
        if len(line) < width:  # a line that fills the last column would begin another
            break
    return f"\r{line[: width - 1]}\x1b[K"


def _summary(live: LiveRelay) -> dict[str, Any]:
    core = live.relay
    flows = [
        {"number": each.number, "address": place_text(each.address), **{lane.direction: lane.counters() for lane in each.lanes}}
        for each in core.flows.values()
    ]  # fmt: skip
    late_us = {
        direction: {name: value if late.count else None for name, value in late.summary_us((50, 99, 99.9)).items()}
        for direction, late in core.late.items()
    }
    return {
        "listen": place_text(live.bound), "to": place_text(live.far), "seconds": live.elapsed_s, "stopped": live.stop.reason,
        "flows": flows, "totals": {direction: core.totals(direction) for direction in DIRECTIONS}, "late_us": late_us,
        "flows_begun": core.begun, "flows_expired": core.expired, "beyond_limit": core.beyond_limit, "trouble": live.counts,
    }  # fmt: skip


def flows_table(live: LiveRelay) -> Fitted:
    """Return a row for each direction of each flow, and the totals; on a narrow terminal in several tables."""
    core = live.relay
    rows = [
        ({"flow": f"{flow.number}", "client": place_text(flow.address), "direction": lane.direction}, lane.counters())
        for flow in core.flows.values()
        for lane in flow.lanes
    ]
    rows += [
        ({"flow": "all", "client": f"{core.begun} flows", "direction": direction}, core.totals(direction))
        for direction in DIRECTIONS
    ]
    shown = ["sent", *OUTCOMES, *(name for name in TROUBLES if any(counters[name] for _, counters in rows))]
    first, second = shown[:5], shown[5:]

    def table(of: Sequence[str], counted: Sequence[str]) -> Table:
        cells = [
            [*(named[each] for each in of), *(f"{counters[each]}" for each in counted)] for named, counters in rows
        ]
        return plain_table([*of, *(each.replace("_", "\n") for each in counted)], cells, left=len(of))

    def clients() -> Table:
        flows = [[f"{flow.number}", place_text(flow.address)] for flow in core.flows.values()]
        return plain_table(("flow", "client"), flows, left=2)

    both, which = ("flow", "client", "direction"), ("flow", "direction")
    return Fitted(
        lambda: [table(both, shown)],
        lambda: [table(both, first), table(which, second)],
        lambda: [clients(), table(which, first), table(which, second)],
    )


def _print_counts(live: LiveRelay, console: Console) -> None:
    core = live.relay
    for direction, late in core.late.items():
        if late.count:
            us = late.summary_us((50, 99))
            late_us = f"{us['p50']:.0f} us (p50), {us['p99']:.0f} us (p99), at most {us['max']:.0f} us"
            say_lines(console, f"{direction}: sent late by {late_us}")
    counts = {"of peers beyond --flows": core.beyond_limit, "flows that expired": core.expired, **live.counts}
    if words := ", ".join(f"{name} {count}" for name, count in counts.items() if count):
        say_lines(console, f"dealt with: {words}")
    refused = [measure for measure in live.measures if not measure.granted]
    if refused:
        say_lines(console, f"without: {', '.join(measure.name for measure in refused)} (`cogrip doctor` says how)")
