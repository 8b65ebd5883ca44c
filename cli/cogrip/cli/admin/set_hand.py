"""`cogrip set`: change hand settings of a person in a running session."""

from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.io.control import MOST_WORD, SetHand


def set_hand(
    name: str,
    /,
    *pairs: Annotated[str, Parameter(allow_leading_hyphen=True)],
    room: str = "",
    state: State = None,
    port: Port = DEFAULT_PORT,
) -> int:
    """Change hand settings of a person in a running session, until they leave; print what holds then.

    The tool stays where it is, and the force ramps in anew. A person changes their own by `set KEY=VALUE` and Enter in the
    terminal of `cogrip join`. Exit code 1 where the server does not run, nobody is called so, or the client does not take it.

    Parameters
    ----------
    name
        Name of the seat.
    pairs
        KEY=VALUE, one or more: position_scale, force_scale (0.1 to 10), rotation ("y -x z", 0,0,1.571 rad, none), clutch (on,
        off), workspace_limit_m ("none", "auto", "box X0 X1 Y0 Y1 Z0 Z1", "sphere X Y Z R" [m]), gravity_compensation (on, off).
    room
        In this room only.
    """
    for what, text in (("name", name), ("--room", room)):
        check_words(f"set: {what}", text, MOST_WORD)
    if not name or "=" in name:
        raise BadInput("set: name somebody first, as the server prints it: cogrip set NAME KEY=VALUE")
    try:
        change = parsed(pairs)
    except ValueError as error:
        raise BadInput(f"set: {error}") from None
    answer, _ = answer_of("set", SetHand(name, change, room), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0
