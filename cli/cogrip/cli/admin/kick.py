"""`cogrip kick`: kick somebody from a running session."""

from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import MOST_REASON, MOST_WORD, KickOrder


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
    """Kick somebody from a running session.

    The seat session or observer slot ends; they may join again, unless --revoke. Exit code 1 where the server does not run or
    nobody is called so.

    Parameters
    ----------
    user
        Name of the seat, or of the observer, as the server prints it.
    room
        In this room only.
    reason
        Shown to them.
    revoke
        Revoke their token as well: everyone who joined by it is kicked, and can join by another one only.
    """
    for what, text, most in (("user", user, MOST_WORD), ("--room", room, MOST_WORD), ("--reason", reason, MOST_REASON)):
        check_words(f"kick: {what}", text, most)
    if not user:
        raise BadInput("kick: name somebody, as the server prints it")
    answer, _ = answer_of("kick", KickOrder(user, room, reason, revoke), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0
