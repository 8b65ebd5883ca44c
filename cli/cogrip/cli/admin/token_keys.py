"""`cogrip token keys`: keys of tokens that others sign, such as the login of a university (`docs/login.md`)."""

import time
from pathlib import Path

from cyclopts import App

from cogrip.cli.admin.state_folder import Port, State, state_at
from cogrip.cli.admin.token_revoke import notify_server
from cogrip.cli.terminal.commands import add_commands
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.cli.terminal.tables import columns_table
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.admission.token_keys import MOST_FILE_BYTES, KeyFileError, read_keys
from cogrip.server.admission.tokens import TokenBook, TokenError, date_text
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.token_file import TokenFile

COMMANDS = {
    "add": ("admin.token_keys:keys_add", "Add a key: whoever signs with it mints tokens of this server."),
    "list": ("admin.token_keys:keys_list", "List the keys of a server; nothing secret of them is shown."),
    "remove": ("admin.token_keys:keys_remove", "Remove keys, and end the seats that were taken with their tokens."),
}
_HEADINGS = ("kid", "algorithm", "audience", "added")


def keys_add(
    file: Path, /, *, kid: str = "", audience: str = "", state: State = None, port: Port = DEFAULT_PORT
) -> int:
    """Add a key: whoever signs with it mints tokens of this server.

    A running server knows it at once. Two keys hold beside each other, so that one can follow another.

    Parameters
    ----------
    file
        An Ed25519 public key (PEM, JSON Web Key or a set of them), or a shared secret of at least 256 bits: a JSON Web Key,
        or one line of hexadecimal digits or base64, whose characters are the secret.
    kid
        Name of the key, as the header of its tokens has it; the one in a JSON Web Key if not given.
    audience
        A name that `aud` of its tokens may be, beside the server's fingerprint.
    """
    folder = state_at(state, port)
    with Problem.of_files(file), file.open("rb") as stream:
        data = stream.read(MOST_FILE_BYTES + 1)
    try:
        made = read_keys(data, kid, audience, time.time())
    except (KeyFileError, ValueError) as error:
        raise BadInput(f"token keys add: {file}: {error}") from None

    def edit(book: TokenBook) -> tuple[TokenBook, None]:
        for key in made:
            book = book.add_key(key)
        return book, None

    with Problem.of(StateError), BadInput.of(TokenError, where="token keys add: "):
        TokenFile(folder).change(edit)
    console = make_console(soft_wrap=True)
    for key in made:
        console.print(f"key {key.kid} is added: its tokens are signed by {key.algorithm}")
    return notify_server(folder, console, "added")


def keys_list(*, state: State = None, port: Port = DEFAULT_PORT, json: Json = None) -> int:
    """List the keys of a server; nothing secret of them is shown."""
    folder = state_at(state, port)
    with Problem.of(StateError):
        there = TokenFile(folder).load().keys
    if json is not None:
        rows = [
            {"kid": key.kid, "algorithm": key.algorithm, "audience": key.audience, "added_s": key.added}
            for key in there
        ]
        write_json({"folder": str(folder.path), "keys": rows}, json)
    elif there:
        cells = [(key.kid, key.algorithm, key.audience or "the fingerprint", date_text(key.added)) for key in there]
        table = [dict(zip(_HEADINGS, row, strict=True)) for row in cells]
        make_console().print(columns_table(_HEADINGS, table))
    else:
        make_console(stderr=True, soft_wrap=True).print(f"no keys in {folder.path}: it takes no signed tokens")
    return 0


def keys_remove(*kids: str, state: State = None, port: Port = DEFAULT_PORT) -> int:
    """Remove keys, and end the seats that were taken with their tokens.

    All are removed, or none. Exit code 1 where the server runs but did not confirm: then only new connections are refused.

    Parameters
    ----------
    kids
        As `cogrip token keys list` shows them.
    """
    if not kids:
        raise BadInput("token keys remove: name at least one key, as `cogrip token keys list` shows them")
    folder = state_at(state, port)

    def edit(book: TokenBook) -> tuple[TokenBook, None]:
        for kid in dict.fromkeys(kids):
            book = book.remove_key(kid)
        return book, None

    with Problem.of(StateError), BadInput.of(TokenError, where="token keys remove: "):
        TokenFile(folder).change(edit)
    console = make_console(soft_wrap=True)
    for kid in dict.fromkeys(kids):
        console.print(f"key {kid} is removed")
    return notify_server(folder, console, "removed")


keys = App(name="keys")
add_commands(keys, COMMANDS)
keys.default(keys_list)
