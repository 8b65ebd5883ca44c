"""`cogrip view`: a session or a recording in the browser."""

import socket
from contextlib import closing
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.session.join_target import target_of, typed
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem, above_zero, within
from cogrip.client.io.paths import JoinError
from cogrip.protocol.io.stop import Stop, on_signals
from cogrip.protocol.session import ClientSession
from cogrip.view.io.feed import LiveFeed
from cogrip.view.io.hand_link import HandLink
from cogrip.view.io.process import PortError, ViewProcess


def view(
    target: Annotated[str, Parameter(allow_leading_hyphen=True)],
    /,
    *more: Annotated[str, Parameter(show=False)],
    room: str = "",
    port: int = 0,
    browser: bool = True,
    foxglove: Annotated[bool, Parameter(negative="")] = False,
    insecure: Annotated[bool, Parameter(negative="")] = False,
    seconds: float | None = None,
    hand: Annotated[int | None, Parameter(show=False)] = None,
) -> int:
    """Show a running session in the browser: object, hands, forces and the state of the network.

    The page is served on this machine alone, at the address that is printed.

    Parameters
    ----------
    target
        The join link that the server printed, in quotes, or HOST:PORT of a server without encryption. - reads it from
        standard input.
    room
        Room to show; any if not given.
    port
        Port of the page on 127.0.0.1; a free one if not given.
    browser
        Open the page in the browser.
    foxglove
        Offer the session to Foxglove and Lichtblick, too.
    insecure
        View a HOST:PORT that is not this machine without encryption: everyone on the path can read it.
    seconds
        End after this time.
    hand
        File descriptor of the link to a `web:` device.
    """
    above_zero("--seconds", seconds)
    within("--port", port, 0, 65535)
    console = make_console(soft_wrap=True)
    joined = target_of(typed(target, more), room, insecure, "", "")
    stop = Stop()
    with on_signals(stop), closing(joined.paths(insecure)) as paths, Problem.of(JoinError), Problem.of(PortError):
        feed = LiveFeed(ClientSession(joined.observer()), paths, console.print)
        feed.connect()
        link = None if hand is None else HandLink(socket.socket(fileno=hand))
        process = ViewProcess(feed, stop, console.print, port, browser, foxglove, hand=link, seconds=seconds)
        ended = process.run()
    if counts := {name: count for name, count in sorted(process.counts.items()) if count}:
        console.print("view: " + ", ".join(f"{name} {count}" for name, count in counts.items()))
    if ended:
        console.print(f"view: the session is over: {ended}")
    return 0
