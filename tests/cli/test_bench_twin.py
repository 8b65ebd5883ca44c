"""Parts of benchmarks in C: the twin of a server and VRPN's library answer every datagram and say what it cost."""

import json
import os
import socket
import sys
from pathlib import Path

import pytest

from cogrip.cli.terminal.problem import BadInput
from cogrip.protocol.secure.channel import UnencryptedChannel
from cogrip.protocol.settings.room import seat_settings

from tests.bench import pauses
from tests.bench.loads.compiled import compiler_of
from tests.bench.loads.people import Swing, make_people
from tests.bench.loads.server import HOST, Job, Process, make_load, settings_of
from tests.bench.loads.twin import VRPN_SOURCES, VRPN_VARIABLE, check_vrpn
from tests.bench.loads.vrpn_person import COOKIE_BYTES, HEADER, VrpnPerson
from tests.bench.pauses import KINDS, PAUSES_US, bench_pauses
from tests.fair_time import FairTime

WAVE = b"\x93\xcb?\xf0\x00\x00\x00\x00\x00\x00"  # msgpack of a list that begins with 1.0
MANY = 100
LIMIT_S = 30.0


needs_compiler = pytest.mark.skipif(compiler_of(".c") is None, reason="no C compiler is installed")
needs_vrpn = pytest.mark.skipif(
    VRPN_VARIABLE not in os.environ or compiler_of(".cpp") is None,
    reason=f"{VRPN_VARIABLE} names no source of VRPN, or no C++ compiler is installed",
)


@needs_compiler
def test_it_answers_each_datagram_with_its_own_and_tells_what_it_took() -> None:
    twin = Process(Job("c", people=1))
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.settimeout(30)
            end.connect((HOST, twin.started.port))
            for number in range(MANY):
                end.send(WAVE + bytes([number % 256]) * (number % 50))
            answers = [end.recv(2048) for _ in range(MANY)]
        twin.ask()
        first = twin.answer()
        twin.ask()
        second = twin.answer()
    finally:
        twin.end()
    assert sorted(answers) == sorted(WAVE + bytes([number % 256]) * (number % 50) for number in range(MANY))
    assert second.time_ns > first.time_ns
    assert second.cpu_ns > first.cpu_ns
    assert first.ticks > 0
    assert 0 <= first.late_us["p50"] <= first.late_us["p99"] <= first.late_us["max"]
    assert 0 < first.memory_kb < 20_000


@needs_compiler
@pytest.mark.skipif(sys.platform != "linux", reason="it is for Linux")
def test_each_access_is_measured_after_each_pause(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pauses, "ROUNDS", 20)
    assert bench_pauses(seconds=0.1, rounds=1, json="-") == 0
    printed = capsys.readouterr()
    found = json.loads(printed.out)
    assert found["pauses_us"] == list(PAUSES_US)
    assert set(found["access_ns"]) == set(KINDS)
    for times_ns in found["access_ns"].values():
        assert len(times_ns) == len(PAUSES_US)
        assert min(times_ns) > 0.0
    assert 0.0 <= found["lost"] <= 1.0
    assert "times a second" in printed.err


@needs_vrpn
@pytest.mark.parametrize(("people", "per_room"), [(1, 1), (5, 2)])
def test_vrpn_answers_everybody_of_a_room(people: int, per_room: int) -> None:
    job = Job("vrpn", people, per_room, vrpn=os.environ[VRPN_VARIABLE])
    vrpn = Process(job)
    load = make_load(job, vrpn)
    try:
        load.join()
        line = Swing(seat_settings(settings_of(job)[0], 0), phase=1.0)
        waited = FairTime()
        for number in range(MANY):
            line.step()
            for each in load.people:
                each.say(line, 0)
            while min(each.received for each in load.people) <= number:
                assert waited.spent_s() < LIMIT_S
                for each in load.people:
                    each.hear(0)
        vrpn.ask()
        assert vrpn.answer().cpu_ns > 0
        assert vrpn.started.port in vrpn.started.ports
        assert len(vrpn.started.ports) == -(-people // per_room)
    finally:
        load.close()
        vrpn.end()


@pytest.mark.parametrize(
    ("sent", "why"),
    [(b"", "VRPN closed the connection"), (bytes(COOKIE_BYTES + HEADER.size), "VRPN sent a message of 0 bytes")],
)
def test_whoever_gets_no_connection_says_why(sent: bytes, why: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind((HOST, 0))
        server.settimeout(30)
        (person,) = make_people(1, 1, [server.getsockname()], UnencryptedChannel, kind=VrpnPerson)
        try:
            person.tend(1)
            host, port = server.recv(100).rstrip(b"\0").split()
            with socket.create_connection((host.decode(), int(port)), timeout=30) as stream:
                stream.sendall(sent)
                stream.shutdown(socket.SHUT_WR)
                waited = FairTime()
                while not person.failed:
                    assert waited.spent_s() < LIMIT_S
                    person.tend(2)
        finally:
            person.close()
    assert person.failed == why
    assert person.state == "closed"


def test_a_folder_without_vrpn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=rf"--vrpn: .*{VRPN_SOURCES[0]} is not there; name a folder with VRPN's source"):
        check_vrpn(tmp_path, 2, 2)


def test_more_people_than_vrpn_can_wait_for_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="is not there"):
        check_vrpn(tmp_path, 252, 2)  # 756 sockets of people, 252 of rooms, 16 of its own
    with pytest.raises(BadInput, match="253 people need more than 1024 sockets"):
        check_vrpn(tmp_path, 253, 2)
