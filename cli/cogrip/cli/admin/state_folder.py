"""State folder of the server that an administrator's command works on, and requests to that server."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.operations import AskedOrder, SetBody
from cogrip.server.administration.orders import (
    KickOrder,
    MarkOrder,
    OrderReply,
    WhoOrder,
)
from cogrip.server.io.control import NotRunningError, ask
from cogrip.server.io.state_folder import (
    NoStateError,
    ServerRecord,
    StateError,
    StateFolder,
    find_folder,
    read_server,
    state_path,
)  # fmt: skip

State = Annotated[Path | None, Parameter(help="The server's state folder; else the one of --port.")]
Port = Annotated[int, Parameter(help="The server's port, which names its state folder.")]


def state_at(state: Path | None, port: int = DEFAULT_PORT) -> StateFolder:
    """Return the folder. Raises BadInput where there is none, Problem where it is not fit for use."""
    with Problem.of(StateError), BadInput.of(NoStateError):
        return find_folder(_path(state, port))


def _path(state: Path | None, port: int) -> Path:
    within("--port", port, 1, 65535)
    path = state_path(state, port)
    assert path is not None  # the port is not 0
    return path


def server_at(folder: StateFolder) -> ServerRecord | None:
    """Return what the server wrote of itself, None where none has. Raises Problem."""
    with Problem.of(StateError):
        return read_server(folder)


def answer_of(
    command: str,
    order: AskedOrder,
    state: Path | None,
    port: int,
) -> tuple[OrderReply, Path]:
    """Return the running server's answer, and its state folder.

    Raises BadInput for an unknown room, Problem where the server refuses or does not run.
    """
    path = _path(state, port)
    try:
        folder = find_folder(path)
        server = read_server(folder) if isinstance(order, WhoOrder | KickOrder | MarkOrder | SetBody) else None
        if server is not None and not server.templates:  # of rooms on demand the server alone knows
            assert isinstance(order, WhoOrder | KickOrder | MarkOrder | SetBody)
            check_known("--room", order.room, list(server.rooms), "room")
        answer = ask(folder, order)
    except (NoStateError, NotRunningError):
        cure = "start it, or name the right one by --state or --port"
        raise Problem(f"no server is running with the state in {path}; {cure}") from None
    except StateError as error:
        raise Problem(str(error)) from None
    if not answer.ok:
        raise Problem(f"{command}: {answer.text}")
    return answer, path


def check_words(what: str, text: str, most: int) -> None:
    """Raise BadInput for a text that is too long, or holds control characters."""
    if len(text) > most:
        raise BadInput(f"{what} has {len(text)} characters, more than {most}; say it shorter")
    if re.search(r"[\x00-\x1f\x7f-\x9f]", text):
        raise BadInput(f"{what} holds a line break or control character; leave it out")


def check_known(flag: str, name: str, known: Sequence[str], what: str) -> None:
    """Raise BadInput, with the nearest, unless `name` is "" or known."""
    if not name or name in known:
        return
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"there is: {', '.join(known)}"
    raise BadInput(f"{flag} {name!r}: the server has no such {what}; {hint}")
