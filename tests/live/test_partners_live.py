"""People who feel each other by models, in real processes: the server is killed with -9, people come, leave and are kicked."""

import signal
from pathlib import Path

import numpy as np
import pytest

from cogrip.results.reading.records import open_run

from tests.free_ports import free_port

MOST_STEP_N = 0.5  # a tick
HELD_N = 3.0
ROOM = """
name = "pulled"
[coupling]
kind = "partner"
stiffness_npm = 1000.0
damping_nspm = 10.0
[object]
axes = 1
mass_kg = 0.2
[link]
delay_ms = 20.0
"""
HANDS = {"anna": "0.03", "ben": "-0.03", "cleo": "0.0"}


def room(folder: Path) -> Path:
    users = [
        f'[[users]]\nname = "{name}"\ndevice = "sim:ideal?mass_kg=0.1&damping_nspm=0.5"\n'
        f'hand = "waypoints&times_s=1,2&x_m=0,{place}&hand_stiffness_npm=300&hand_damping_nspm=5"\n'
        for name, place in HANDS.items()
    ]  # fmt: skip
    path = folder / "pulled.toml"
    path.write_text(ROOM + "".join(users), encoding="utf-8")
    return path


def forces_of(runs: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return ticks, and force [N] of each, of somebody's recording."""
    end = open_run(next(runs.iterdir())).clients[name]
    columns = end.columns("tick", "tick", "force_n")
    return columns["tick"].astype(int), columns["force_n"].astype(float).reshape(-1)


@pytest.mark.long
def test_nobody_feels_a_step_where_the_server_is_killed_and_people_come_and_go(run, tmp_path: Path) -> None:
    config, port, state = room(tmp_path), free_port(), tmp_path / "state"

    def serve(number: int):
        server = run(
            "serve", config, "--port", str(port), "--state", state, "--seconds", "60", "--no-record", "--no-report",
            "--runs", tmp_path / f"server {number}",
        )  # fmt: skip
        server.hear("listening on")
        return server

    def join(name: str, *arguments: str):
        person = run(
            "join", f"127.0.0.1:{port}", "--config", config, "--name", name, "--no-report", "--runs", tmp_path / name,
            *arguments,
        )  # fmt: skip
        return person

    server = serve(0)
    anna, ben = join("anna"), join("ben")
    for person in (anna, ben):
        person.hear("holds cube")
    join("cleo", "--seconds", "4").end()
    server.signal(signal.SIGKILL)
    server.end()
    anna.hear("force released")
    server = serve(1)
    for name in ("anna", "ben"):
        server.hear(rf"{name} (joined|resumed) from")
    join("cleo", "--seconds", "3").end()
    assert run("kick", "ben", "--state", state).end() == 0
    assert ben.end() == 1
    join("cleo", "--seconds", "2").end()
    anna.signal(signal.SIGINT)
    assert anna.end() == 0, anna.said
    server.signal(signal.SIGTERM)
    server.end()
    for name in ("anna", "ben"):
        ticks, forces = forces_of(tmp_path / name, name)
        assert np.isfinite(forces).all()
        assert np.abs(forces).max() > HELD_N
        steps = np.abs(np.diff(forces)) / np.diff(ticks)  # of ticks that a busy machine skipped the copy makes up
        assert steps.max() <= MOST_STEP_N, name
