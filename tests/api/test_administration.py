"""A running server from Python, plain and with an event loop: real sockets, and a server that answers between its ticks."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

import cogrip.api as cogrip
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import RoomChange
from cogrip.protocol.wire.join_link import parse_link
from cogrip.server.administration.orders import (
    CloseRoomOrder,
    KickOrder,
    MarkOrder,
    NewRoomOrder,
    RoomEntry,
    SetHandOrder,
    SetRoomOrder,
    StatusOrder,
    WhoOrder,
)
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.admission.tokens import token_hash
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_server
from cogrip.server.io.token_file import TokenFile

from tests.cli.answering_server import answering

ANNA = RosterEntry("anna", "lab", "192.0.2.7:1000", 1.5, 0)
LAB = RoomEntry("lab", 2, 1, 0, 128, (0.1,), 0.02)


@pytest.fixture
def folder(tmp_path: Path) -> StateFolder:
    return make_folder(tmp_path / "state")


def answer(order: Any) -> dict[str, Any]:
    if isinstance(order, KickOrder):
        return {"ok": False, "text": "nobody here is 'ben'; there is: anna"}
    return {"text": "done", "people": (ANNA,), "rooms": (LAB,)}


def test_each_method_is_its_order_and_a_refusal_an_error(folder: StateFolder) -> None:
    with answering(folder, answer) as orders:
        server = cogrip.Administration(folder.path)
        assert server.set("anna", stiffness_npm=400, clutch=True) == "done"
        assert server.set(room="lab", object__mass_kg=0.5) == "done"
        server.mark("trial 1", "lab")
        assert server.who("lab") == (ANNA,)
        assert server.rooms() == (LAB,)
        with pytest.raises(cogrip.ApiError, match="nobody here is 'ben'"):
            server.kick("ben", "lunch", revoke=True)
        with pytest.raises(cogrip.ApiError, match="'rates' is nothing that can be set"):
            server.set("anna", rates=1)
    assert orders == [
        SetHandOrder("anna", parsed(["stiffness_npm=400", "clutch=on"])), SetRoomOrder(RoomChange(0.5), "lab"),
        MarkOrder("trial 1", "lab"), WhoOrder("lab"), StatusOrder(), KickOrder("ben", "", "lunch", True),
    ]  # fmt: skip


def test_an_event_loop_has_the_same(folder: StateFolder) -> None:
    async def ask() -> None:
        server = cogrip.AsyncAdministration(folder.path)
        assert await server.set("anna", stiffness_npm=400) == "done"
        await server.mark("trial 1")
        assert [each.name for each in await server.who()] == ["anna"]
        assert [each.speed_mps for each in await server.rooms()] == [0.02]
        with pytest.raises(cogrip.ApiError, match="nobody here"):
            await server.kick("ben")
        with pytest.raises(cogrip.ApiError, match=r"no .joined. of anna: it did not come within 0\.05 s"):
            await server.wait_for("joined", user="anna", seconds=0.05)
        assert [each async for each in server.events(seconds=0.05)] == []

    with answering(folder, answer):
        asyncio.run(ask())


def test_a_server_that_does_not_run_is_named(folder: StateFolder, tmp_path: Path) -> None:
    with pytest.raises(cogrip.ApiError, match="no server is running"):
        cogrip.Administration(folder.path).who()
    with pytest.raises(cogrip.ApiError, match="nowhere"):
        cogrip.Administration(tmp_path / "nowhere")


def test_rooms_and_tokens_have_links(folder: StateFolder) -> None:
    write_server(folder, ServerRecord("lab.example", 47811, "ab" * 32, {"lab": ["anna"]}, 1, {"lesson": ["anna"]}))
    group = RoomEntry("group 7", 2, 0, 0, 128, (0.0,), 0.0, "", "lesson", {"class": "physics"})

    def opened(order: Any) -> dict[str, Any]:
        return {"text": "done", "rooms": (group,)}

    with answering(folder, opened) as orders:
        server = cogrip.Administration(folder.path)
        room = server.new_room("lesson", labels={"class": "physics"})
        server.close_room("group 7")
    assert orders == [NewRoomOrder("lesson", "", {"class": "physics"}), CloseRoomOrder("group 7")]
    assert room.name == "group 7"
    assert {role: parse_link(link).room for role, link in room.links.items()} == dict.fromkeys(
        ("player", "observer"), "group 7"
    )
    link = server.new_token(role="observer", once=True, seconds=60.0, note="visitor")
    (token,) = [each for each in TokenFile(folder).load().tokens if each.note == "visitor"]
    assert (token.hash, token.role, token.once) == (token_hash(parse_link(link).token), "observer", True)
    assert token.expires is not None
    with pytest.raises(cogrip.ApiError, match="seat"):
        server.new_token(role="observer", seat="anna")
