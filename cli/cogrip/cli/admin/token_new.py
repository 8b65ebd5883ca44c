"""`cogrip token new`: a token, and its join link."""

import difflib
import re
import sys
import time
from csv import DictWriter
from datetime import date, datetime, timedelta
from datetime import time as day_time
from typing import Annotated, Any

from cyclopts import Parameter

from cogrip.cli.admin.state_folder import Port, State, check_known, check_words, server_at, state_at
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem, within
from cogrip.devices.registry import schemes
from cogrip.protocol.wire.join_link import DEFAULT_PORT, JoinLink, LinkError, split_place
from cogrip.protocol.wire.messages import DEVICE_BYTES, Role
from cogrip.server.admission.tokens import MOST_TOKENS, Token, TokenBook, TokenError, date_text
from cogrip.server.io.state_folder import ServerRecord, StateError, StateFolder
from cogrip.server.io.token_file import TokenFile, draw_token

EVERYWHERE = ("0.0.0.0", "::")
_SECONDS = {"s": 1, "m": 60, "h": 3600, "d": 86400, "w": 604800}
_MOST_S = 10 * 366 * 86400
_MOST_NOTE, _MOST_DEVICE = 200, DEVICE_BYTES  # most characters of a note and of a device, as in `tokens.Token`


def token_new(
    *,
    role: Role = "player",
    room: str = "",
    name: str = "",
    device: str = "",
    once: Annotated[bool, Parameter(negative="")] = False,
    expires: str = "",
    note: str = "",
    host: str = "",
    count: int = 1,
    csv: Annotated[bool, Parameter(negative="")] = False,
    state: State = None,
    port: Port = DEFAULT_PORT,
    json: Json = None,
) -> int:
    """Make a token, and print its join link.

    The link alone goes to standard output, and is never shown again.

    Parameters
    ----------
    role
        A player may hold the object, or observe; an observer may observe.
    room
        For this room only; any if not given.
    name
        For this seat only; any if not given.
    device
        For devices whose address begins so only, such as hid:woodenhaptics.
    once
        Good for one time. Whoever joined by it still resumes after a lost connection.
    expires
        After so long (90s, 30m, 2h, 3d, 1w), or at a time (2026-12-24T18:00, this machine's), or at the end of a day
        (2026-12-24: good all that day); never if not given.
    note
        For `cogrip token list`: who has it.
    host
        HOST or HOST:PORT by which this person reaches the server; else as the server recorded.
    count
        Make so many of the same terms: all, or none.
    csv
        Give them as a table: id, link, and the terms.
    """
    within("--count", count, 1, MOST_TOKENS)
    if csv and json is not None:
        raise BadInput("--csv and --json exclude each other; leave one out")
    if json not in (None, "-"):
        raise BadInput(
            f"--json {json}: the answer holds a secret and is given once; have it on standard output (--json -)"
        )
    check_words("token new: --device", device, _MOST_DEVICE)
    check_words("token new: --note", note, _MOST_NOTE)
    folder = state_at(state, port)
    server = _encrypted_server(folder)
    known = {**server.rooms, **server.templates}
    if not server.templates:  # of rooms on demand the server alone knows
        check_known("--room", room, list(known), "room")
    seats = [seat for each in ([room] if room in known else known) for seat in known[each]]
    check_known("--name", name, seats, "seat")
    now_s = time.time()
    end_s = expiry(expires, now_s) if expires else None
    where = place_of_link(host, server)
    terms: dict[str, Any] = {
        "role": role, "room": room, "user": name, "device": device, "once": once, "expires": end_s, "note": note
    }  # fmt: skip
    secrets = [draw_token() for _ in range(count)]

    def edit(book: TokenBook) -> tuple[TokenBook, list[Token]]:
        made = []
        for secret in secrets:
            book, token = book.new(secret, now_s, **terms)
            made.append(token)
        return book, made

    with Problem.of(StateError), BadInput.of(LinkError, TokenError, where="token new: "):
        links = [JoinLink(*where, room, server.fingerprint, secret) for secret in secrets]
        made = TokenFile(folder).change(edit)
    errors = make_console(stderr=True, soft_wrap=True)
    if warning := _device_warning(device):
        errors.print(f"warning: {warning}")
    rows = [_as_json(token, link) for token, link in zip(made, links, strict=True)]
    if json is not None:
        write_json(rows[0] if count == 1 else {"tokens": rows}, json)
    elif csv:
        table = DictWriter(sys.stdout, list(rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
    else:
        for token, link in zip(made, links, strict=True):
            errors.print(f"token {token.id}: {_terms(token)}")
            print(link.text)
    return 0


def _device_warning(device: str) -> str:
    """Return a warning of an unknown device family, "" for none: the client may have drivers that this machine has not."""
    scheme, colon, _ = device.partition(":")
    known = sorted(schemes())
    if scheme in known or (not colon and any(each.startswith(scheme) for each in known)):
        return ""
    near = difflib.get_close_matches(scheme, known, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"there is: {', '.join(known)}"
    return (
        f"--device {device!r}: no device family here is called {scheme!r}, so perhaps nobody can join by this; {hint}"
    )


def expiry(text: str, now_s: float) -> int:
    """Return Unix seconds of a time from now, of a date with a time, or of the end of a day. Raises BadInput."""
    if found := re.fullmatch(r"([0-9]{1,9}) ?([smhdwSHDW])", text.strip()):  # not M: that may be meant as a month
        end_s = now_s + int(found[1]) * _SECONDS[found[2].lower()]
    else:
        try:
            end_s = _date_s(text.strip())
        except (ValueError, OverflowError, OSError):
            raise BadInput(
                f"--expires {text!r}: write 30m, 2h, 3d, 1w, a time such as 2026-12-24T18:00, or a day such as 2026-12-24"
            ) from None
    if end_s <= now_s:
        raise BadInput(f"--expires {text!r}: that is past; name a later time")
    if end_s - now_s > _MOST_S:
        raise BadInput(f"--expires {text!r}: that is more than ten years; leave it out for a token without an end")
    return int(end_s)


def _date_s(text: str) -> float:
    """Return Unix seconds of a date. Raises ValueError, OverflowError, OSError."""
    try:
        day = date.fromisoformat(text)
    except ValueError:
        return datetime.fromisoformat(text).astimezone().timestamp()
    return datetime.combine(day + timedelta(days=1), day_time()).astimezone().timestamp()


def _encrypted_server(folder: StateFolder) -> ServerRecord:
    """Return the record of the server whose key the link needs. Raises BadInput."""
    server = server_at(folder)
    if server is None:
        raise BadInput(
            f"{folder.path}: no server has been started here, and a link needs its key; start `cogrip serve` first"
        )
    if not server.fingerprint:
        raise BadInput(
            f"{folder.path}: the server is unencrypted, and asks nobody for a token; serve on another address than "
            "loopback, or with --encrypted"
        )
    return server


def place_of_link(host: str, server: ServerRecord) -> tuple[str, int]:
    """Return host and port of the server for the link. Raises BadInput."""
    if host:
        with BadInput.of(LinkError, where="--host: "):
            name, port = split_place(host)
        return name, port or server.port
    if server.host in EVERYWHERE:
        raise BadInput(f"the server listens on all addresses ({server.host}); name the one for the link: --host NAME")
    return server.host, server.port


def _terms(token: Token) -> str:
    """Return the rights of a token in words."""
    seat = f"seat {token.user}" if token.user else "any seat"
    terms = [
        token.role,
        f"room {token.room}" if token.room else "any room",
        *([] if token.role == "observer" else [seat]),
    ]
    if token.device:
        terms.append(f"device {token.device}")
    terms.append("one time" if token.once else "standing")
    if token.expires is not None:
        terms.append(f"until {date_text(token.expires)}")
    return ", ".join(terms)


def _as_json(token: Token, link: JoinLink) -> dict[str, Any]:
    return {
        "id": token.id, "link": link.text, "role": token.role, "room": token.room, "seat": token.user,
        "device": token.device, "once": token.once, "expires_s": token.expires, "note": token.note,
    }  # fmt: skip
