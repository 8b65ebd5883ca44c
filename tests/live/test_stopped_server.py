"""A server whose processes stand still for some seconds, and go on: real processes, real sockets, real signals."""

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.live.held_arms import Spoken, fairly, until
from tests.live.test_unauthenticated_peers import (
    MOST_STEP_N,
    PULL,
    Server,
    before_silence,
    largest_step_n,
    recording_of,
)
from tests.live.test_workers import Rooms, leave

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="several workers need Linux")

STANDS_STILL_S = 3.0  # longer than a seat is kept without a datagram
SILENT = "the server is silent: trying to resume"


def one_process(start: Callable[..., Spoken], base: Path, encryption: str) -> tuple[Spoken, list[int], tuple[str, ...]]:
    """Start a server; returns it, its processes, and where its room is."""
    made = Server(base, encryption)
    start.all.append(made.process)  # type: ignore[attr-defined]  # it is ended with the others
    where = made.link("player").text if encryption == "--seal" else f"127.0.0.1:{made.port}"
    return made.process, [made.process.popen.pid], (where,)


def with_workers(
    start: Callable[..., Spoken], base: Path, encryption: str
) -> tuple[Spoken, list[int], tuple[str, ...]]:
    """Start a server of several workers, and return the same."""
    made = Rooms(start, base, encryption)
    return made.process, [made.process.popen.pid, made.worker(1), made.worker(2)], made.where("cellar")


@pytest.mark.long
@pytest.mark.parametrize("encryption", ["--insecure", "--seal"])
@pytest.mark.parametrize("serve", [one_process, with_workers])
@fairly
def test_people_of_a_server_that_stood_still_go_on_at_once(start, tmp_path, serve, encryption):
    server, processes, where = serve(start, tmp_path, encryption)
    people = []
    for name in ("anna", "ben"):
        people.append(start("join", *where, "--name", name, "--no-report", "--runs", tmp_path / name, *PULL))
        people[-1].runs = tmp_path / name
        people[-1].hear(f"{name} holds cube")
    for process in processes:
        os.kill(process, signal.SIGSTOP)
    stopped_s = time.monotonic()
    try:
        for person in people:
            person.hear(SILENT)
        until(lambda: time.monotonic() - stopped_s >= STANDS_STILL_S, "it stood still")
    finally:
        for process in processes:
            os.kill(process, signal.SIGCONT)
    for person in people:
        person.hear(r"resumed after ([\d.]+) s")
        person.hear("force ramps in")
    leave(*people)
    for person in people:
        end = recording_of(person)
        assert person.said.count(SILENT) == 1, "once resumed, they hold on"
        assert largest_step_n(end, before_silence(end)) < MOST_STEP_N
    server.popen.send_signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    if encryption == "--insecure":  # hellos by new paths, which need no handshake, have kept the seats
        assert "lost the seat" not in server.said
