"""`cogrip room new`: open a room on demand, and make its join links."""

import time
from typing import Annotated

from cyclopts import Parameter

from cogrip.cli.admin.room_labels import labels_of
from cogrip.cli.admin.state_folder import Port, State, answer_of, check_known, check_words, server_at, state_at
from cogrip.cli.admin.token_new import place_of_link
from cogrip.cli.terminal.output import Json, make_console, write_json
from cogrip.cli.terminal.problem import BadInput, Problem
from cogrip.protocol.secure.channel import place_text
from cogrip.protocol.wire.join_link import DEFAULT_PORT, JoinLink, LinkError
from cogrip.protocol.wire.messages import Role
from cogrip.server.administration.orders import MOST_WORD, NewRoomOrder
from cogrip.server.admission.tokens import TokenBook, TokenError
from cogrip.server.io.state_folder import ServerRecord, StateError, StateFolder
from cogrip.server.io.token_file import TokenFile, draw_token

ROLES: tuple[Role, ...] = ("player", "observer")


def room_new(
    template: str,
    /,
    *,
    name: str = "",
    label: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    host: str = "",
    qr: Annotated[bool, Parameter(negative="")] = False,
    state: State = None,
    port: Port = DEFAULT_PORT,
    json: Json = None,
) -> int:
    """Open a room of a template in a running server, and print how people join it: a link for players, and one for observers.

    The room is closed once it has been empty for a while (`cogrip serve --empty-after`), and its links are void then. At an
    unencrypted server there are no links: people join by address and room.

    Parameters
    ----------
    template
        As the server's settings file calls it (`cogrip serve --template FILE:COUNT`).
    name
        Name of the room; one is drawn if not given.
    label
        KEY=VALUE, by which `cogrip room list` finds it; repeatable, at most 8.
    host
        HOST or HOST:PORT by which people reach the server; else as the server recorded.
    qr
        Print a QR code of the players' link, at a terminal.
    """
    check_words("room new: template", template, MOST_WORD)
    check_words("room new: --name", name, MOST_WORD)
    if json not in (None, "-"):
        raise BadInput(f"--json {json}: the answer holds secrets, given once; have it on standard output (--json -)")
    folder = state_at(state, port)
    server = server_at(folder)
    if server is not None:
        check_known("room new", template, list(server.templates), "template")
    order = NewRoomOrder(template, name, labels_of(label, "room new"))
    answer, _ = answer_of("room new", order, state, port)
    (room,) = answer.rooms
    assert server is not None  # it has answered
    links = links_of(folder, server, room.name, host)
    if json is not None:
        write_json({"room": room.name, "template": room.template, "labels": dict(room.labels), "links": links}, json)
        return 0
    errors = make_console(stderr=True, soft_wrap=True)
    errors.print(answer.text)
    for role, link in links.items():
        errors.print(f"join as {role}:")
        print(link)
    if qr:
        from cogrip.cli.terminal.qr_code import print_qr_code  # takes a while

        print_qr_code(links["player"], make_console())
    return 0


def links_of(folder: StateFolder, server: ServerRecord, room: str, host: str) -> dict[str, str]:
    """Return a link by role; of an unencrypted server the command by which people join. Raises BadInput, Problem."""
    if not server.fingerprint:
        return {"player": f"cogrip join {place_text((server.host, server.port))} --room '{room}'"}
    where, now_s = place_of_link(host, server), time.time()
    secrets = {role: draw_token() for role in ROLES}

    def edit(book: TokenBook) -> tuple[TokenBook, None]:
        for role, secret in secrets.items():
            book, _ = book.new(secret, now_s, role=role, room=room, note="room on demand")
        return book, None

    with Problem.of(StateError), BadInput.of(LinkError, TokenError, where="room new: "):
        TokenFile(folder).change(edit)
        return {role: JoinLink(*where, room, server.fingerprint, secret).text for role, secret in secrets.items()}
