"""`cogrip token revoke`: revoke tokens, and end the seats that were taken with them."""

import re
import time
from typing import Annotated

from cyclopts import Parameter
from rich.console import Console

from cogrip.cli.admin.state_folder import Port, State, state_at
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import ReloadOrder
from cogrip.server.admission.tokens import SPENT_S, TokenBook, TokenError, is_jti, token_hash
from cogrip.server.io.control import ControlError, NotRunningError, ask
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.token_file import TokenFile

ID_DIGITS = 8


def token_revoke(
    *ids: Annotated[str, Parameter(allow_leading_hyphen=True)], state: State = None, port: Port = DEFAULT_PORT
) -> int:
    """Revoke tokens, and end the seats that were taken with them.

    All are revoked, or none. Exit code 1 where the server runs but did not confirm: then only new connections are refused.

    Parameters
    ----------
    ids
        As `cogrip token list` shows them; of a signed token its jti, also where it has not been seen here.
    """
    if not ids:
        raise BadInput("token revoke: name at least one id, as `cogrip token list` shows them")
    wanted = [_id(text) for text in ids]
    folder = state_at(state, port)
    now_s = time.time()

    def edit(book: TokenBook) -> tuple[TokenBook, dict[str, bool]]:
        """Return the new book, and whether each was revoked before."""
        before: dict[str, bool] = {}
        for ident in dict.fromkeys(wanted):
            if is_jti(ident):
                if not book.keys or any(token_hash(ident) == token.hash for token in book.tokens):
                    raise _no_id(ident)
                changed = book.spend(ident, "revoke", now_s + SPENT_S, now_s)
            else:
                changed = book.revoke(ident, now_s)
            before[ident], book = changed is book, changed
        return book, before

    with Problem.of(StateError):
        try:
            before = TokenFile(folder).change(edit)
        except TokenError as error:
            raise BadInput(f"token revoke: {error} (nothing was changed)") from None
    console = make_console(soft_wrap=True)
    for ident, already in before.items():
        console.print(f"{ident} {'was revoked before' if already else 'is revoked'}")
    return notify_server(folder, console, "revoked")


def _id(text: str) -> str:
    """Return the id; a text that may be a token is not shown. Raises BadInput."""
    if is_jti(text):
        return text
    if not re.fullmatch(rf"[0-9a-fA-F]{{{ID_DIGITS}}}", text):
        raise _no_id(text)
    return text.lower()


def _no_id(text: str) -> BadInput:
    given = f"{len(text)} characters" if len(text) != ID_DIGITS else "other characters"
    return BadInput(
        f"token revoke: an id has {ID_DIGITS} hexadecimal digits, as `cogrip token list` shows it; what is given has {given} "
        "(a signed token's is its jti, of 10 to 40 letters, digits, - and _; a token is never its own id)"
    )


def notify_server(folder: StateFolder, console: Console, done: str) -> int:
    """Let a running server read the tokens again. Return the exit code. Raises Problem. done: what was done in the file"""
    try:
        answer = ask(folder, ReloadOrder())
    except NotRunningError:
        console.print("no server is running there: it will read this at its start")
        return 0
    except ControlError as error:
        words = (
            "the server does not know yet"
            if done == "added"
            else "nobody new can join by it, but seats taken with it may last"
        )
        raise Problem(f"{done}, and {words}: {error}") from None
    if not answer.ok:
        raise Problem(f"{done}, but the server could not read it: {answer.text}")
    console.print(f"the server has read it: {answer.text}")
    return 0
