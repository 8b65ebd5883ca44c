"""Tests of the files that a session reads besides its settings, and of their digests."""

import hashlib
from pathlib import Path

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.input_files import UNREADABLE, files_read


def user(**changes: object) -> dict[str, object]:
    return {"name": "a", **changes}


@pytest.mark.parametrize(
    "changes",
    [
        {"hand": "csv:FILE&time=t_s&x=x_m"},
        {"device": "sim:ideal?hand=csv:FILE&time=t_s&x=x_m"},
        {"device": "emulated:vintage", "hand": "csv:FILE&time=t_s&x=x_m"},
        {"device": "replay:FILE#time=t_s&x=x_m"},
    ],
)
def test_a_recorded_hand_wherever_it_is_named(tmp_path: Path, changes: dict[str, str]) -> None:
    file = tmp_path / "hand.csv"
    for text in ("t_s,x_m\n0,0\n1,0.01\n", "t_s,x_m\n0,0\n1,0.02\n"):
        file.write_text(text)
        named = {key: value.replace("FILE", str(file)) for key, value in changes.items()}
        found = files_read(resolve({"users": [user(**named)]}))
        assert found == {str(file): hashlib.sha256(text.encode()).hexdigest()}


def test_traces_of_both_directions_and_nothing_else(tmp_path: Path) -> None:
    up, down = tmp_path / "up.csv", tmp_path / "down.csv"
    up.write_text("t_s,delay_ms\n0,1\n")
    table = {
        "link": {"up": {"trace": str(up)}, "down": {"trace": str(down)}},
        "users": [user(hand="tremor&seed=3"), user(name="b", device="sim:ideal")],
    }
    found = files_read(resolve(table))
    assert found == {str(up): hashlib.sha256(up.read_bytes()).hexdigest(), str(down): UNREADABLE}
    assert files_read(resolve({"users": [user()]})) == {}


def test_a_recorded_person_of_a_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    run_laboratory(resolve({"seconds": 0.1, "users": [user(), user(name="b")]}), run)
    for changes in ({"hand": f"recording:{run}#user=b"}, {"device": f"replay:{run}#user=b"}):
        found = files_read(resolve({"users": [user(**changes)]}))
        (recording,) = run.glob("client-b*.mcap")
        assert found == {f"{run}#user=b": hashlib.sha256(recording.read_bytes()).hexdigest()}
    assert files_read(resolve({"users": [user(device=f"replay:{tmp_path}/none#user=b")]})) == {
        f"{tmp_path}/none#user=b": UNREADABLE
    }
