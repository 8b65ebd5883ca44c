"""Parts of benchmarks in C: the twin of a server and VRPN's library answer every datagram and say what it cost."""

import json
import os
import socket
import sys
from pathlib import Path

import pytest

from cogrip.cli.terminal.problem import BadInput

from tests.bench.loads.compiled import compiler_of
from tests.bench.loads.server import HOST, Job, Process
from tests.bench.loads.twin import VRPN_SOURCES, VRPN_VARIABLE, check_vrpn
from tests.bench.network import measure
from tests.bench.pauses import KINDS, PAUSES_US, bench_pauses

WAVE = b"\x93\xcb?\xf0\x00\x00\x00\x00\x00\x00"  # msgpack of a list that begins with 1.0
MANY = 100


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
def test_each_access_is_measured_after_each_pause(capsys: pytest.CaptureFixture[str]) -> None:
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
def test_vrpn_sends_each_person_a_datagram_a_frame(people: int, per_room: int) -> None:
    found = measure(Job("vrpn", people, per_room, vrpn=os.environ[VRPN_VARIABLE]), seconds=1.0)
    assert found.ticks > 0
    assert found.cpu_us > 0.0
    assert found.sent > 0
    assert found.received >= 0.9 * found.sent - 4 * people
    assert found.received <= found.sent + 4 * people


def test_a_folder_without_vrpn_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=rf"--vrpn: .*{VRPN_SOURCES[0]} is not there; name a folder with VRPN's source"):
        check_vrpn(tmp_path, 2, 2)


def test_more_people_than_vrpn_can_wait_for_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="is not there"):
        check_vrpn(tmp_path, 252, 2)  # 756 sockets of people, 252 of rooms, 16 of its own
    with pytest.raises(BadInput, match="253 people need more than 1024 sockets"):
        check_vrpn(tmp_path, 253, 2)
