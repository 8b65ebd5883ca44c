"""`cogrip view`: a session or a recording in the browser."""

import socket
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.runs.run_folder import RUNS, found_run, nowhere
from cogrip.cli.session.front_ends import FoxgloveOrigins, front_ends
from cogrip.cli.session.join_target import target_of, typed
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.parameters import RunsBelow
from cogrip.cli.terminal.problem import BadInput, Problem, above_zero, within
from cogrip.client.io.paths import JoinError, find
from cogrip.machine.stop import Stop, on_signals
from cogrip.protocol.wire.session import ClientSession
from cogrip.view.io.feed import Feed, LiveFeed, RecordedFeed
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.process import PortError, ViewProcess
from cogrip.view.page import self_contained
from cogrip.view.recording import RecordedView, ViewError, open_view
from cogrip.view.scene import to_json


def view(
    target: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    room: str = "",
    port: int = 0,
    browser: bool = True,
    foxglove: Annotated[bool, Parameter(negative="")] = False,
    foxglove_origin: FoxgloveOrigins = (),
    insecure: Annotated[bool, Parameter(negative="")] = False,
    seconds: float | None = None,
    out: Path | None = None,
    runs: RunsBelow = RUNS,
    hand: Annotated[int | None, Parameter(show=False)] = None,
) -> int:
    """Show a running session in the browser, or a recorded one: object, hands, forces and the state of the network.

    The page is served on this machine alone, at the address that is printed.

    Parameters
    ----------
    target
        The join link that the server printed, in quotes, or HOST:PORT of a server without encryption; - reads it from
        standard input. Or a run folder, or its name in `runs` (--runs).
    room
        Room to show; any if not given.
    port
        Port of the page on 127.0.0.1; a free one if not given.
    browser
        Open the page in the browser.
    foxglove
        Offer the session to Foxglove and Lichtblick, too: their programs, app.foxglove.dev, and pages of this machine.
    insecure
        View a HOST:PORT that is not this machine without encryption: everyone on the path can read it.
    seconds
        End after this time.
    out
        Write the page with the recording into this file, instead of serving it: it opens anywhere, without a network.
    """
    above_zero("--seconds", seconds)
    within("--port", port, 0, 65535)
    offered = front_ends(foxglove, foxglove_origin)
    console = make_console(soft_wrap=True)
    if out is not None or Path(target).exists() or (runs / target).exists():
        run = found_run(Path(target), runs)
        with BadInput.of(ViewError):
            recorded = open_view(run)
        if out is not None:
            return _write(recorded, out, console)
        return _serve(RecordedFeed(recorded), None, console, port, browser, offered, seconds)
    text = typed(target, more)
    joined = target_of(text, room, insecure, "", "")
    if ":" not in text:  # it may be meant as a name of a run
        try:
            find(joined.host, joined.port)
        except JoinError:
            raise BadInput(f"{text}: is no server that is known here, and no run{nowhere(text, runs)}") from None
    with closing(joined.paths(insecure)) as paths, Problem.of(JoinError):
        feed = LiveFeed(ClientSession(joined.observer()), paths, console.print)
        feed.connect()
        link = None if hand is None else HandLink(socket.socket(fileno=hand), feed.tell_hands)
        return _serve(feed, link, console, port, browser, offered, seconds)


def _serve(
    feed: Feed,
    hand: HandLink | None,
    console: Console,
    port: int,
    browser: bool,
    offered: tuple[str, ...],
    seconds: float | None,
) -> int:
    """Serve a feed until it is stopped or over. Return the exit code."""
    stop = Stop()
    process = ViewProcess(
        feed, stop, console.print, port, browser, bool(offered), front_ends=offered, hand=hand, seconds=seconds
    )
    with on_signals(stop), Problem.of(PortError):
        ended = process.run()
    if counts := {name: count for name, count in sorted(process.counts.items()) if count}:
        console.print("view: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    if ended:
        console.print(f"view: the session is over: {ended}")
    return 0


def _write(recorded: RecordedView, out: Path, console: Console) -> int:
    """Write a recording's page into one file. Return the exit code."""
    scene = recorded.scene
    text = self_contained(to_json(scene), [recorded.chunk(number) for number in range(scene.chunks)])
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise Problem(f"--out {out}: {error.strerror}; name a file in a folder that you can write to") from None
    console.print(f"{out}: {scene.duration_s or 0.0:.1f} s of {scene.room}, {len(text) / 1e6:.1f} MB")
    return 0
