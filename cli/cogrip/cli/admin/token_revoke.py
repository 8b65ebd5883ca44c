"""`cogrip token revoke`: revoke tokens, and end the seats that were taken with them."""

import re
import time

from rich.console import Console

from cogrip.cli.admin.state_folder import Port, State, state_at
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import ReloadOrder
from cogrip.server.admission.tokens import TokenBook, UnknownTokenError
from cogrip.server.io.control import ControlError, NotRunningError, ask
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.token_file import TokenFile

ID_DIGITS = 8


def token_revoke(*ids: str, state: State = None, port: Port = DEFAULT_PORT) -> int:
    """Revoke tokens, and end the seats that were taken with them.

    All are revoked, or none. Exit code 1 where the server runs but did not confirm: then only new connections are refused.

    Parameters
    ----------
    ids
        As `cogrip token list` shows them.
    """
    if not ids:
        raise BadInput("token revoke: name at least one id, as `cogrip token list` shows them")
    wanted = [_id(text) for text in ids]
    folder = state_at(state, port)
    now_s = time.time()

    def edit(book: TokenBook) -> tuple[TokenBook, list[str]]:
        already = [ident for ident in wanted if book.find(ident).revoked is not None]
        for ident in wanted:
            book = book.revoke(ident, now_s)
        return book, already

    with Problem.of(StateError):
        try:
            already = TokenFile(folder).change(edit)
        except UnknownTokenError as error:
            raise BadInput(f"token revoke: {error} (nothing was changed)") from None
    console = make_console(soft_wrap=True)
    for ident in dict.fromkeys(wanted):
        console.print(f"{ident} {'was revoked before' if ident in already else 'is revoked'}")
    return _notify_server(folder, console)


def _id(text: str) -> str:
    """Return the id; a text that may be a token is not shown. Raises BadInput."""
    if not re.fullmatch(rf"[0-9a-fA-F]{{{ID_DIGITS}}}", text):
        given = f"{len(text)} characters" if len(text) != ID_DIGITS else "other characters"
        raise BadInput(
            f"token revoke: an id has {ID_DIGITS} hexadecimal digits, as `cogrip token list` shows it; what is given "
            f"has {given}"
        )
    return text.lower()


def _notify_server(folder: StateFolder, console: Console) -> int:
    try:
        answer = ask(folder, ReloadOrder())
    except NotRunningError:
        console.print("no server is running there: it will read this at its start")
        return 0
    except ControlError as error:
        raise Problem(f"revoked, and nobody new can join by it, but seats taken with it may last: {error}") from None
    if not answer.ok:
        raise Problem(f"revoked, but the server could not read it: {answer.text}")
    console.print(f"the server has read it: {answer.text}")
    return 0
