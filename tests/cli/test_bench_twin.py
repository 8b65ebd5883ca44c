"""Parts of benchmarks in C: the twin of a server answers every datagram, and says what it cost; pauses are measured."""

import json
import shutil
import socket
import sys

import pytest

from tests.bench.loads.compiled import COMPILERS
from tests.bench.loads.server import HOST, Job, Process
from tests.bench.pauses import KINDS, PAUSES_US, bench_pauses

WAVE = b"\x93\xcb?\xf0\x00\x00\x00\x00\x00\x00"  # msgpack of a list that begins with 1.0
MANY = 100


needs_compiler = pytest.mark.skipif(not any(map(shutil.which, COMPILERS)), reason="no C compiler is installed")


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
