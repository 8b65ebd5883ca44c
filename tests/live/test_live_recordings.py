"""Recordings of live processes play again bit for bit: every settings file, three axes or more, a bad network."""

import signal
import tomllib
from pathlib import Path

import pytest

from cogrip.protocol.recording.folder import recordings_of
from cogrip.protocol.recording.reader import open_recording
from cogrip.results.replay.verify import verify

from tests.extent import every
from tests.live.test_live_sessions import FEW_FRAMES

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
BAD = ("--set", "link.loss=0.1", "--set", "link.jitter_ms=5", "--set", "link.duplicate=0.05")
CROWD = (
    "sixteen-users"  # more processes than a small machine runs in time: the laboratory's recordings of it are verified
)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    "config",
    every(16, [path for path in sorted(CONFIGS.glob("*.toml")) if path.stem != CROWD]),
    ids=lambda path: path.stem,
)
def test_a_live_session_plays_again_exactly(run, serve, tmp_path, config):
    table = tomllib.loads(config.read_text())
    three = () if table.get("object", {}).get("kind") == "scene" else ("--set", "object.axes=3")  # a scene has its own
    server, port = serve(config, *BAD, *three)
    names = [user["name"] for user in table["users"]]
    people = [
        run(
            "join", f"127.0.0.1:{port}", "--config", config, *BAD, *three, "--name", name, "--seconds", "1",
            "--runs", tmp_path / name, "--no-report",
        )
        for name in names
    ]  # fmt: skip
    for person in people:
        person.end()
    server.signal(signal.SIGTERM)
    server.end()
    folders = [folder for base in (*names, "server") for folder in (tmp_path / base).iterdir()]
    files = [file for folder in folders for file in recordings_of(folder)]
    assert len(files) == len(names) + 1
    for file in files:
        found = verify(open_recording(file))
        assert found.exact, found
        assert not found.cut
        assert found.ticks > FEW_FRAMES
