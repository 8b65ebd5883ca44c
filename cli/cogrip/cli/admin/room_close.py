"""`cogrip room close`: close a room on demand."""

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import MOST_WORD, CloseRoomOrder


def room_close(name: str, /, *, state: State = None, port: Port = DEFAULT_PORT) -> int:
    """Close a room on demand; whoever is in it is sent out, and its links are void.

    Parameters
    ----------
    name
        As `cogrip room list` shows it.
    """
    check_words("room close", name, MOST_WORD)
    answer, _ = answer_of("room close", CloseRoomOrder(name), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0
