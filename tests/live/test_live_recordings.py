"""What live processes record plays again bit by bit, for every settings file, on three axes, through a bad network."""

from pathlib import Path

import pytest

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_a_live_session_verifies(run, tmp_path, config):
    bad = [
        "--set",
        "object.axes=3",
        "--set",
        "link.loss=0.1",
        "--set",
        "link.jitter_ms=5",
        "--set",
        "link.duplicate=0.05",
    ]
    demo = run("demo", "--config", config, "--seconds", "1.5", "--runs", tmp_path, *bad)
    demo.end()  # 1: it is too short to move the object
    (folder,) = tmp_path.iterdir()
    replay = run("replay", folder, "--verify")
    assert replay.end() == 0, replay.said
    assert replay.said.count("equal, bit by bit") == len(list(folder.glob("*.mcap"))) >= 2
