"""A running server from Python, plain and with an event loop: real sockets, and a server that answers between its ticks."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

import cogrip.api as cogrip
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.settable import RoomChange
from cogrip.server.administration.orders import (
    KickOrder,
    MarkOrder,
    RoomEntry,
    SetHandOrder,
    SetRoomOrder,
    StatusOrder,
    WhoOrder,
)
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.io.state_folder import StateFolder, make_folder

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
