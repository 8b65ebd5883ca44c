"""`cogrip room`: what is asked of the server, the links that are made, and words for all that does not fit."""

from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.wire.join_link import JoinLink, parse_link
from cogrip.server.administration.orders import CloseRoomOrder, NewRoomOrder, RoomEntry, StatusOrder
from cogrip.server.admission.tokens import token_hash
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_server
from cogrip.server.io.token_file import TokenFile

from tests.cli.answering_server import answering
from tests.cli.command import Cogrip

GROUP = RoomEntry("group 7", 2, 1, 0, 128, (0.1,), 0.0, "", "lesson", {"class": "physics"})
LAB = RoomEntry("lab", 2, 0, 0, 128, (0.0,), 0.0)


@pytest.fixture
def state(tmp_path: Path) -> StateFolder:
    folder = make_folder(tmp_path / "state")
    write_server(
        folder, ServerRecord("lab.example", 47811, "ab" * 32, {"lab": ["anna"]}, 1, {"lesson": ["anna", "ben"]})
    )
    return folder


def answer(order: Any) -> dict[str, Any]:
    if isinstance(order, CloseRoomOrder):
        return {"text": f"{order.room}: closed; sessions ended: 2"}
    return {
        "text": "group 7: open, of template lesson",
        "rooms": (GROUP, LAB) if isinstance(order, StatusOrder) else (GROUP,),
    }


def test_a_new_room_has_a_link_for_players_and_one_for_observers(cogrip: Cogrip, state: StateFolder) -> None:
    with answering(state, answer) as orders:
        found = cogrip.answer(
            "room", "new", "lesson", "--name", "group 7", "--label", "class=physics", "--state", state.path
        )
    assert orders == [NewRoomOrder("lesson", "group 7", {"class": "physics"})]
    assert (found["room"], found["template"], found["labels"]) == ("group 7", "lesson", {"class": "physics"})
    links = {role: parse_link(text) for role, text in found["links"].items()}
    book = TokenFile(state).load()
    assert [(token.role, token.room, token.note) for token in book.tokens] == [
        ("player", "group 7", "room on demand"), ("observer", "group 7", "room on demand"),
    ]  # fmt: skip
    for role, link in links.items():
        assert isinstance(link, JoinLink)
        assert (link.host, link.port, link.room) == ("lab.example", 47811, "group 7")
        assert [token.role for token in book.tokens if token.hash == token_hash(link.token)] == [role]


def test_rooms_are_listed_by_label(cogrip: Cogrip, state: StateFolder) -> None:
    with answering(state, answer):
        names = [each["name"] for each in cogrip.answer("room", "list", "--state", state.path)["rooms"]]
        some = cogrip.answer("room", "list", "--label", "class=physics", "--state", state.path)["rooms"]
        table = cogrip.out("room", "list", "--state", state.path)
        assert cogrip.out("room", "list", "--label", "class=art", "--state", state.path) == "no room has these labels\n"
    assert names == ["group 7", "lab"]
    assert [each["name"] for each in some] == ["group 7"]
    assert "group 7  lesson    1 of 2  0          class=physics" in table


def test_a_room_is_closed_by_its_name(cogrip: Cogrip, state: StateFolder) -> None:
    with answering(state, answer) as orders:
        assert cogrip.out("room", "close", "group 7", "--state", state.path) == "group 7: closed; sessions ended: 2\n"
    assert orders == [CloseRoomOrder("group 7")]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("new", "lessons"), "the server has no such template; did you mean 'lesson'?"),
        (("new", "lesson", "--label", "physics"), "--label 'physics': write KEY=VALUE"),
        (("new", "lesson", "--name", "x" * 41), "has 41 characters, more than 40"),
        (("new", "lesson", "--json", "file"), "given once; have it on standard output"),
    ],
)
def test_what_does_not_fit_says_why(cogrip: Cogrip, state: StateFolder, arguments: tuple[str, ...], why: str) -> None:
    assert why in cogrip.err("room", *arguments, "--state", state.path)
