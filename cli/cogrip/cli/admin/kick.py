"""`cogrip kick`: show somebody out of a running session."""

from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.admin.state_folder import Port, State, check_known, check_words, server_at, state_at
from cogrip.cli.terminal.console import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.join_link import DEFAULT_PORT
from cogrip.server.io.control import MOST_REASON, MOST_WORD, Kick, ask
from cogrip.server.io.state_folder import StateError


def kick(
    user: str,
    /,
    *,
    room: str = "",
    reason: str = "",
    revoke: Annotated[bool, Parameter(negative="")] = False,
    state: State = None,
    port: Port = DEFAULT_PORT,
) -> int:
    """End the seat of a person, or an observer's place. They may come back, unless --revoke.

    Exit code 1 where the server does not run or nobody is called so.

    Parameters
    ----------
    user
        Name of the seat, or of the observer, as the server prints it.
    room
        In this room only.
    reason
        What they are told.
    revoke
        Revoke their token as well: they come back by another one only. Everyone who came by it is kicked.
    """
    for what, text, most in (("user", user, MOST_WORD), ("--room", room, MOST_WORD), ("--reason", reason, MOST_REASON)):
        check_words(f"kick: {what}", text, most)
    if not user:
        raise BadInput("kick: name somebody, as the server prints it")
    folder = state_at(state, port)
    server = server_at(folder)
    if server is not None:
        check_known("--room", room, list(server.rooms), "room")
    try:
        answer = ask(folder, Kick(user, room, reason, revoke))
    except StateError as error:
        raise Problem(str(error)) from None
    if not answer.ok:
        raise Problem(f"kick: {answer.text}")
    make_console(soft_wrap=True).print(answer.text, markup=False)
    return 0
