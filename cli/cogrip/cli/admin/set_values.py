"""`cogrip set`: change settings of a person, or of a room, in a running session."""

from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import Fitted, columns_table, say
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import NOT_SETTABLE, PERSON, ROOM, Settable, room_change
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.operations import SetBody
from cogrip.server.administration.orders import MOST_WORD


def set_values(
    *words: Annotated[str, Parameter(allow_leading_hyphen=True)],
    room: str = "",
    state: State = None,
    port: Port = DEFAULT_PORT,
) -> int:
    """Change settings of a person, or of a room, in a running session; print what holds then.

    Without words: what can be set, and why the rest cannot. What is set of a person holds until they leave; of a room until the
    server stops. Each change is a marker in every recording. A person changes what is their own hand's by `set KEY=VALUE` and
    Enter in the terminal of `cogrip join`. Exit code 1 where the server does not run, nobody is called so, or the client or the
    room does not take it.

    Parameters
    ----------
    words
        NAME KEY=VALUE ...: of the seat of that name. KEY=VALUE ...: of the room.
    room
        In this room only.
    """
    if not words:
        _print_settable()
        return 0
    name, pairs = ("", words) if "=" in words[0] else (words[0], words[1:])
    for what, text in (("name", name), ("--room", room)):
        check_words(f"set: {what}", text, MOST_WORD)
    try:
        _ = parsed(pairs) if name else room_change(pairs)
    except ValueError as error:
        own = not name and all(pair.partition("=")[0] in {row.key for row in PERSON} for pair in pairs)
        whose = f"set: name somebody first: cogrip set NAME {pairs[0]}" if own else f"set: {error}"
        raise BadInput(whose) from None
    values = {key.strip(): value.strip().strip("\"'") for key, _, value in (pair.partition("=") for pair in pairs)}
    answer, _ = answer_of("set", SetBody(values, name, room), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0


def _print_settable() -> None:
    console = make_console()
    for title, rows in (("of a person, cogrip set NAME KEY=VALUE", PERSON), ("of a room, cogrip set KEY=VALUE", ROOM)):
        console.print(f"{title}:", markup=False)
        console.print(_table(rows))
    say(console, "The numbers are sections of docs/theory.md. Not in a session:")
    for key, why in NOT_SETTABLE.items():
        say(console, f"{key}: {why}")


def _table(rows: Sequence[Settable]) -> Fitted:
    headings = ("key", "values", "how")
    cells = [dict(zip(headings, (row.key, row.values, row.law), strict=True)) for row in rows]
    return Fitted(
        lambda: [columns_table(headings, cells)],
        lambda: [columns_table(headings[:2], cells), columns_table((headings[0], headings[2]), cells)],
    )
