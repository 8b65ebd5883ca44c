"""`cogrip token list`: the tokens of a server, and their states."""

import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from rich.table import Table

from cogrip.cli.admin.state_folder import Port, State, server_at, state_at
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import Fitted, columns_table
from cogrip.protocol.texts import shown
from cogrip.protocol.wire.join_link import DEFAULT_PORT
from cogrip.server.administration.orders import WhoOrder
from cogrip.server.admission.tokens import Token, TokenBook, TokenState, date_text, is_jti
from cogrip.server.io.control import ControlError, ask
from cogrip.server.io.state_folder import StateError, StateFolder
from cogrip.server.io.token_file import TokenFile

_TONES: dict[str, str] = {"good": "green", "used": "dim", "expired": "dim", "revoked": "red"}
_HEADINGS = ("id", "role", "room", "seat", "device", "good for", "state", "when", "note")
_SIGNED_HEADINGS = ("signed (jti)", "state", "who", "expires")
_NO_CONTENT = ("any", "-", "")  # values without content: a column in which every row has one of them is left out
_PIPED_WIDTH = 10_000  # width of the table in a pipe: one line for each row


def token_list(*, state: State = None, port: Port = DEFAULT_PORT, json: Json = None) -> int:
    """List the tokens of a server, and their states.

    Oldest first. The tokens themselves are stored nowhere: only hashes are. Of signed tokens those are listed by which
    somebody is here, and those that were used up or revoked and have not expired.
    """
    folder = state_at(state, port)
    with Problem.of(StateError):
        book = TokenFile(folder).load()
    tokens = book.tokens
    signed = _signed(book, folder)
    server = server_at(folder)
    if server is not None and not server.fingerprint:
        note = f"note: the server with the state in {folder.path} is unencrypted, and asks nobody for a token"
        make_console(stderr=True, soft_wrap=True).print(note)
    now_s = time.time()
    if json is not None:
        write_json(
            {"folder": str(folder.path), "tokens": [_as_json(token, now_s) for token in tokens], "signed": signed}, json
        )
        return 0
    if not tokens and not signed:
        make_console(stderr=True, soft_wrap=True).print(f"no tokens in {folder.path}")
        return 0
    console = make_console(piped_width=_PIPED_WIDTH)
    if tokens:
        console.print(token_tables(tokens, now_s))
    if signed:
        rows = [
            {"signed (jti)": str(each["jti"]), "state": str(each["state"]), "who": shown(", ".join(each["people"])) or "-",
             "expires": f"by {date_text(each['until_s'])}" if each["until_s"] else "-"}
            for each in signed
        ]  # fmt: skip
        console.print(columns_table(_SIGNED_HEADINGS, rows, tints={"state": _TONES}))
    return 0


def _signed(book: TokenBook, folder: StateFolder) -> list[dict[str, Any]]:
    """Return what is known of signed tokens: those by which people are here, and those that are void until they expire."""
    people: dict[str, list[str]] = {}
    if book.keys or book.spent:
        with suppress(ControlError):  # no server: nobody is here
            for each in ask(folder, WhoOrder()).people:
                if is_jti(each.token):
                    people.setdefault(each.token, []).append(each.name)
    spent = {each.jti: each for each in book.spent if each.until > time.time()}
    rows = []
    for jti in dict.fromkeys([*people, *spent]):
        void = spent.get(jti)
        state = "good" if void is None else "used" if void.revoked is None else "revoked"
        rows.append({
            "jti": jti, "state": state, "people": people.get(jti, []), "until_s": void and void.until,
            "used_s": void and void.used, "revoked_s": void and void.revoked,
        })  # fmt: skip
    return rows


def token_tables(tokens: Sequence[Token], now_s: float) -> Fitted:
    """Return a row a token; where that is too wide, in several tables with its id. Columns without content are left out."""
    rows = [dict(zip(_HEADINGS, _cells(token, now_s), strict=True)) for token in tokens]
    kept = [heading for heading in _HEADINGS if not {row[heading] for row in rows} <= set(_NO_CONTENT)]

    def tables(*groups: Sequence[str]) -> list[Table]:
        wanted = ([heading for heading in group if heading in kept] for group in groups)
        return [columns_table(group, rows, tints={"state": _TONES}) for group in wanted if len(group) > 1]

    right = ("id", "role", "state", "good for", "when")
    return Fitted(
        lambda: tables(_HEADINGS),
        lambda: tables(right, ("id", "room", "seat", "device", "note")),
        lambda: tables(right, ("id", "room", "seat"), ("id", "device"), ("id", "note")),
        lambda: tables(right, ("id", "room"), ("id", "seat"), ("id", "device"), ("id", "note")),
    )


def _cells(token: Token, now_s: float) -> tuple[str, ...]:
    """Return the cells below _HEADINGS."""
    state = token.state(now_s)
    seat, device = ("-", "-") if token.role == "observer" else (token.user or "any", token.device or "any")
    good_for = "one time" if token.once else "standing"
    return token.id, token.role, token.room or "any", seat, device, good_for, state, _when(token, state), token.note


def _when(token: Token, state: TokenState) -> str:
    """Return the date of the last change of the state, or of the next."""
    if state == "revoked":
        return f"at {date_text(token.revoked or 0)}"
    if state == "used":
        return f"at {date_text(token.used or 0)}"
    if token.expires is not None:
        return f"{'at' if state == 'expired' else 'until'} {date_text(token.expires)}"
    return f"since {date_text(token.created)}"


def _as_json(token: Token, now_s: float) -> dict[str, Any]:
    """Return all but the hash. Dates are Unix seconds."""
    return {
        "id": token.id, "role": token.role, "room": token.room, "seat": token.user, "device": token.device,
        "once": token.once, "start": token.start, "state": token.state(now_s), "created_s": token.created,
        "expires_s": token.expires, "used_s": token.used, "revoked_s": token.revoked, "note": token.note,
    }  # fmt: skip
