"""`cogrip token list`: who may come in, and what has become of each right."""

import os
import time
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from cogrip.cli.json_answer import Json, write_json
from cogrip.cli.problem import Problem
from cogrip.cli.state_at import Port, State, state_at
from cogrip.protocol.join_link import DEFAULT_PORT
from cogrip.server.io.state_folder import StateError
from cogrip.server.io.token_file import TokenFile
from cogrip.server.tokens import Token, TokenState, date_text

_TONES: dict[TokenState, str] = {"good": "green", "used": "dim", "expired": "dim", "revoked": "red"}
_HEADINGS = ("id", "role", "room", "seat", "device", "good for", "state", "when", "note")
_MOST_WIDE = 200  # where it is not shown on a terminal: no line is cut in two
_ANY = "any"


def token_list(*, state: State = None, port: Port = DEFAULT_PORT, json: Json = None) -> int:
    """List the tokens of a server, oldest first. The tokens themselves are nowhere: only hashes are kept."""
    folder = state_at(state, port)
    try:
        tokens = TokenFile(folder).load().tokens
    except StateError as error:
        raise Problem(str(error)) from None
    now_s = time.time()
    if json is not None:
        write_json({"folder": str(folder.path), "tokens": [_as_json(token, now_s) for token in tokens]}, json)
        return 0
    if not tokens:
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"no tokens in {folder.path}", markup=False)
        return 0
    console = Console(highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = _MOST_WIDE
    table = Table(box=None, header_style="dim", padding=(0, 1, 0, 0))
    for heading in _HEADINGS:
        table.add_column(heading, no_wrap=heading != "note", overflow="fold")
    for token in tokens:
        ails = token.state(now_s)
        table.add_row(
            Text(token.id),
            Text(token.role),
            Text(token.room or _ANY),
            Text("-" if token.role == "observer" else token.user or _ANY),
            Text("-" if token.role == "observer" else token.device or _ANY),
            Text("one time" if token.once else "standing"),
            Text(ails, style=_TONES[ails]),
            Text(_when(token, ails)),
            Text(token.note),
        )
    console.print(table)
    return 0


def _when(token: Token, ails: TokenState) -> str:
    """The date that matters."""
    if ails == "revoked":
        return f"at {date_text(token.revoked or 0)}"
    if ails == "used":
        return f"at {date_text(token.used or 0)}"
    if token.expires is not None:
        return f"{'at' if ails == 'expired' else 'until'} {date_text(token.expires)}"
    return f"since {date_text(token.created)}"


def _as_json(token: Token, now_s: float) -> dict[str, Any]:
    """All but the hash. Dates are Unix seconds."""
    return {
        "id": token.id,
        "role": token.role,
        "room": token.room,
        "seat": token.user,
        "device": token.device,
        "once": token.once,
        "start": token.start,
        "state": token.state(now_s),
        "created": token.created,
        "expires": token.expires,
        "used": token.used,
        "revoked": token.revoked,
        "note": token.note,
    }
