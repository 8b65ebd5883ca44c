"""`cogrip mark`: set a marker in a running session."""

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.protocol.wire.messages import MARK_BYTES
from cogrip.server.administration.orders import MOST_WORD, MarkOrder


def mark(text: str, /, *, room: str = "", state: State = None, port: Port = DEFAULT_PORT) -> int:
    """Set a marker in a running session: it stands in the recordings of the server and of everybody in the room.

    Exit code 1 where the server does not run. A person sets one with `m TEXT` and Enter in the terminal of `cogrip join`.

    Parameters
    ----------
    text
        What it says.
    room
        In this room only; in every room if not given.
    """
    check_words("mark: text", text, MARK_BYTES)
    check_words("mark: --room", room, MOST_WORD)
    if len(text.encode()) > MARK_BYTES:
        raise BadInput(f"mark: text has {len(text.encode())} bytes of UTF-8, more than {MARK_BYTES}; say it shorter")
    if not text.strip():
        raise BadInput("mark: the text is empty; say what happened")
    answer, _ = answer_of("mark", MarkOrder(text, room), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0
