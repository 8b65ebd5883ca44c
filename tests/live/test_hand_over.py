"""A server that is started anew under people, in the order of systemd: stop the old one, then start the new one."""

import json
import signal
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest

from cogrip.protocol.recording.reader import Follower, RecordingError, open_recording
from cogrip.protocol.recording.records import kind_of
from cogrip.results.reading.folder import client_recording

from tests.extent import long
from tests.live.held_arms import DEMO, until

RAMP_NS = 600_000_000  # twice the ramp in which force comes back
FELT_N = 0.1
WAIT_S = 40.0
MOST_BACK_S = 2.0  # The longest time until all are back, counted from when the new process listens.
MOST_STEP_N = (
    0.5  # The largest step of a hand's force from tick to tick until the ramp is over; the slope lets 0.98 N pass.
)


def forces(folder: Path, name: str) -> list[tuple[int, list[float]]]:
    """Return time [ns] and force of each tick of a client's recording."""
    recording = open_recording(folder / client_recording(name))
    tick = next(number for number, topic in enumerate(recording.topics) if kind_of(topic) == "tick")
    return [(each.time_ns, json.loads(each.payload)["force_n"]) for each in recording.messages() if each.topic == tick]


def feels(folder: Path, name: str) -> None:
    """Wait until that hand feels a force."""
    follower: list[Follower] = []

    def felt() -> bool:
        with suppress(FileNotFoundError, RecordingError):  # not there, or not whole yet
            if not follower:
                follower.append(Follower(folder / client_recording(name)))
            found = {kind_of(topic): message for topic, message in follower[0].look().items()}
            return "tick" in found and abs(json.loads(found["tick"].payload)["force_n"][0]) > FELT_N
        return False

    until(felt, f"{name} feels a force")


@pytest.mark.parametrize("workers", [1, long(2)])
def test_everybody_is_back_soon_after_a_restart(run, tmp_path: Path, workers: int) -> None:
    state, port, configs = tmp_path / "state", "0", [DEMO]
    if workers > 1:
        other = tmp_path / "other.toml"
        other.write_text(DEMO.read_text().replace('name = "demo"', 'name = "other"'))
        configs.append(other)

    def serve():
        server = run(
            "serve", *configs, "--encrypted", "--port", port, "--state", state, "--runs", tmp_path / "runs", "--no-report",
            "--no-record", "--seconds", "600", "--hand-over", str(WAIT_S), "--workers", str(workers),
        )  # fmt: skip
        return server, server.hear(r"listening on \S+:(\d+)")[1]

    server, port = serve()
    link = server.hear(r"demo as player:  cogrip join '([^']+)'")[1]
    people = {
        name: run(
            "join", link, "--name", name, "--device", "sim:phantom?hand=reach", "--no-report", "--into", tmp_path / name
        )
        for name in ("anna", "ben")
    }
    for name in people:
        server.hear(f"{name} joined")
    for name in people:
        feels(tmp_path / name, name)
    stopped_ns = time.monotonic_ns()
    server.signal(signal.SIGTERM)
    assert server.end() in (0, 1), server.said
    for person in people.values():
        person.hear("the server restarts: held off until it is back")
    server, _ = serve()
    listens_ns = time.monotonic_ns()
    for person in people.values():
        person.hear("resumed after")
    for name in people:
        server.hear(f"{name} resumed")
    back_ns = time.monotonic_ns()
    back_s = (back_ns - listens_ns) * 1e-9
    print(f"back {back_s:.2f} s after the new process listens")
    for person in people.values():
        person.hear("force ramps in")
    for name in people:
        feels(tmp_path / name, name)
    for person in people.values():
        person.signal(signal.SIGINT)
        assert person.end() == 0, person.said
    for name in people:
        ticks = [
            force for time_ns, force in forces(tmp_path / name, name) if stopped_ns <= time_ns <= back_ns + RAMP_NS
        ]
        steps = [max(abs(b - a) for a, b in zip(before, after, strict=True)) for before, after in pairwise(ticks)]
        print(f"{name}: largest step {max(steps):.3f} N in {len(steps)} ticks")
        assert max(steps) <= MOST_STEP_N
    assert back_s <= MOST_BACK_S
    server.signal(signal.SIGINT)
    server.end()
    assert not list(state.glob("checkpoint-*")), "an end in order leaves none"


def test_seats_that_the_next_program_cannot_take_are_not_kept_waiting(
    run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An upgrade under a running server has another form of checkpoints: people are told at once, and no hand waits for it."""
    site, state = tmp_path / "site", tmp_path / "state"
    site.mkdir()
    monkeypatch.setenv("PYTHONPATH", str(site))
    server = run(
        "serve", DEMO, "--port", "0", "--state", state, "--runs", tmp_path / "runs", "--no-report", "--no-record",
        "--seconds", "600", "--hand-over", str(WAIT_S),
    )  # fmt: skip
    port = server.hear(r"listening on \S+:(\d+)")[1]
    person = run("join", f"127.0.0.1:{port}", "--name", "anna", "--no-report", "--into", tmp_path / "anna")
    server.hear("anna joined")
    (site / "sitecustomize.py").write_text("import cogrip.server.checkpoint\ncogrip.server.checkpoint.VERSION = 99\n")
    server.signal(signal.SIGTERM)
    server.hear("no seat is handed over: cogrip .*, which is installed now, has checkpoint 99, not 1")
    person.hear("which is installed now, has checkpoint 99, not 1; join anew")
    assert "the server restarts" not in person.said
    assert person.end() == 1, person.said
    server.end()
    assert not list(state.glob("checkpoint-*")), "nobody goes on from there"
