"""The state folder that a command is to work on, and what the server there said of itself."""

import difflib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.join_link import DEFAULT_PORT
from cogrip.server.io.state_folder import (
    NoStateError,
    ServerRecord,
    StateError,
    StateFolder,
    find_folder,
    read_server,
    state_path,
)

State = Annotated[Path | None, Parameter(help="The server's state folder; else the one of --port.")]
Port = Annotated[int, Parameter(help="The server's port: says which state folder of this user it has.")]


def state_at(state: Path | None, port: int = DEFAULT_PORT) -> StateFolder:
    """Raises BadInput where there is no such folder, Problem where it is not fit for use."""
    if not 0 < port < 65536:
        raise BadInput(f"--port {port} is outside 1 to 65535")
    path = state_path(state, port)
    assert path is not None  # the port is not 0
    try:
        return find_folder(path)
    except NoStateError as error:
        raise BadInput(str(error)) from None
    except StateError as error:
        raise Problem(str(error)) from None


def server_at(folder: StateFolder) -> ServerRecord | None:
    """Raises Problem for a record that cannot be read."""
    try:
        return read_server(folder)
    except StateError as error:
        raise Problem(str(error)) from None


def check_words(what: str, text: str, most: int) -> None:
    """Raises BadInput for what is too long, or would upset a terminal."""
    if len(text) > most:
        raise BadInput(f"{what} has {len(text)} characters, more than {most}; say it shorter")
    if re.search(r"[\x00-\x1f\x7f-\x9f]", text):
        raise BadInput(f"{what} holds a line break or control character; leave it out")


def check_known(flag: str, name: str, known: Sequence[str], what: str) -> None:
    """Raises BadInput, with the nearest, unless `name` is "" or known."""
    if not name or name in known:
        return
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"there is: {', '.join(known)}"
    raise BadInput(f"{flag} {name!r}: the server has no such {what}; {hint}")
