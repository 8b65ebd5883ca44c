"""`cogrip who`, asked of a server that answers."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from cogrip.server.administration.orders import OrderReply, WhoOrder
from cogrip.server.admission.roster import RosterEntry
from cogrip.server.io.state_folder import ServerRecord, StateFolder, make_folder, write_server

from tests.cli.answering_server import answering
from tests.cli.command import Cogrip

PEOPLE = (
    RosterEntry("anna", "lab", "10.0.0.7:5", 3723.4, 0, "sim:phantom\x1b[2J", 41.25, 20.0, 21.25, 7, True),
    RosterEntry("ben", "lab", "away", 61.0, 1, "mouse:", None, None, None, 0),
    RosterEntry("observer 1", "lab", "[::1]:9", 0.0),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StateFolder:
    monkeypatch.setenv("COLUMNS", "300")
    folder = make_folder(tmp_path / "state")
    write_server(folder, ServerRecord("lab.example", 47811, "", {"lab": ["anna", "ben"]}, 1))
    return folder


@pytest.fixture
def asked(folder: StateFolder) -> Iterator[list[object]]:
    with answering(folder, lambda order: {"text": "3 in 1 room", "people": PEOPLE}) as orders:
        yield orders


def test_a_line_a_person(cogrip: Cogrip, folder: StateFolder, asked: list[object]) -> None:
    out, err = cogrip.texts("who", "--state", folder.path)
    assert err == ""
    assert [line.rstrip() for line in out.splitlines()] == [
        "name        room  seat       address     since    rtt ms  up ms  down ms  lost  device",
        "anna        lab   0          10.0.0.7:5  1:02:03    41.2   20.0     21.2     7  sim:phantom\\x1b[2J",
        "ben         lab   1 (comes)  away        1:01          -      -        -     0  mouse:",
        "observer 1  lab   observes   [::1]:9     0:00          -      -        -     -  -",
        "3 in 1 room",
    ]
    assert asked == [WhoOrder("")]


def test_as_json(cogrip: Cogrip, folder: StateFolder, asked: list[object]) -> None:
    out = cogrip.out("who", "--room", "lab", "--json", "-", "--state", folder.path)
    anna, _, observer = json.loads(out)["people"]
    assert [anna[key] for key in ("up_ms", "down_ms", "lost", "since_s", "holds")] == [20.0, 21.25, 7, 3723.4, True]
    assert (observer["seat"], observer["rtt_ms"], observer["device"]) == (None, None, "")
    assert asked == [WhoOrder("lab")]
    assert "did you mean 'lab'?" in cogrip.err("who", "--room", "lap", "--state", folder.path)


@pytest.mark.parametrize("command", ["who", "kick anna", "mark now"])
def test_without_a_server_it_is_said_in_one_way(cogrip: Cogrip, folder: StateFolder, command: str) -> None:
    cure = "start it, or name the right one by --state or --port"
    for where in (folder.path, folder.path.with_name("nowhere")):
        said = f"cogrip: no server is running with the state in {where}; {cure}\n"
        assert cogrip(f"{command} --state {where}") == (1, "", said)


@pytest.mark.parametrize("server", ["127.0.0.1:47811", "localhost:47811", "[::1]:47811"])
def test_the_servers_address_names_its_port(cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, server: str) -> None:
    ports = []
    monkeypatch.setattr(
        "cogrip.cli.admin.who.answer_of",
        lambda _, order, state, port: ports.append(port) or (OrderReply(True, "nobody"), Path()),
    )
    cogrip.out("who", server)
    assert ports == [47811]


def test_another_machine_is_not_asked_and_the_cure_is_said(cogrip: Cogrip) -> None:
    assert "ssh 192.0.2.7 cogrip who --port 4711" in cogrip.err("who", "192.0.2.7:4711")
    assert "give one of them" in cogrip.err("who", "127.0.0.1:4711", "--port", "4712")
    assert "write HOST:PORT" in cogrip.err("who", "127.0.0.1:port")


def test_what_a_gate_lends_gave_and_got_stands_below(
    cogrip: Cogrip, folder: StateFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    person = RosterEntry("anna", "lab", "10.0.0.7:5", 1.0, 0, gate_j=-0.0125, gave_j=0.25, got_j=0.0312)
    early = RosterEntry("ben", "lab", "10.0.0.8:5", 1.0, 1, gave_j=0.0, got_j=0.0)
    with answering(folder, lambda order: {"text": "2 in 1 room", "people": (person, early)}):
        out = cogrip.out("who", "--state", folder.path)
    assert "anna: gate: 37.5 of 50 mJ left, it says; gave 250.0 mJ to the others, got 31.2 mJ\n" in out
    assert "ben: gate: not told; gave 0.0 mJ to the others, got 0.0 mJ\n" in out
