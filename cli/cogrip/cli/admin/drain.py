"""`cogrip drain`: let the rooms of a host of a cluster move to others."""

from cogrip.cli.admin.state_folder import Port, State, answer_of, check_words
from cogrip.cli.terminal.output import make_console
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import MOST_REASON, DrainOrder


def drain(host: str, /, *, state: State = None, port: Port = DEFAULT_PORT) -> int:
    """Let the rooms of a host of a cluster move to others, and place none there any more.

    Their people keep their seats: they resume by their tickets within a second or two. Ask any front. Exit code 1 where no
    server runs, there is no such host, or it is the last one.

    Parameters
    ----------
    host
        Its address, or the beginning of its node id as `ray status` shows it.
    """
    check_words("drain: host", host, MOST_REASON)
    answer, _ = answer_of("drain", DrainOrder(host), state, port)
    make_console(soft_wrap=True).print(answer.text)
    return 0
