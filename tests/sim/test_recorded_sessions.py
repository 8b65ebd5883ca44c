"""Sessions recorded by an earlier version play again bit by bit. Meant to change: `python3 dev.py rerecord`."""

import json
import platform
from pathlib import Path

import pytest

from cogrip.protocol.recording.reader import open_recording
from cogrip.sim.replay.verify import verify

RECORDINGS = Path(__file__).resolve().parents[1] / "recordings"
FILES = sorted(RECORDINGS.glob("*/*.mcap"))


def test_both_sessions_are_here():
    assert {path.parent.name for path in FILES} == {"laboratory", "live"}
    assert len(FILES) == 6
    assert sum(path.stat().st_size for path in FILES) < 1_000_000


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_it_plays_again_bit_by_bit(path):
    recording = open_recording(path)
    if recording.header.versions.machine != platform.machine():
        pytest.skip(f"recorded on {recording.header.versions.machine}, this is {platform.machine()}")
    found = verify(recording)
    assert found.exact, found
    assert not found.cut
    rate_hz = recording.header.rate_hz
    assert found.ticks > 0.7 * rate_hz


def test_the_laboratory_still_comes_to_the_same_numbers(tmp_path):
    """From the settings, not from the record: devices, hands and links are the same as well."""
    from cogrip.protocol.settings import resolve
    from cogrip.sim.lab_run import run_laboratory

    table = json.loads((RECORDINGS / "laboratory" / "settings.json").read_text())
    run_laboratory(resolve(table), tmp_path)
    for name in ("client-anna.mcap", "client-ben.mcap", "server.mcap"):
        old, new = open_recording(RECORDINGS / "laboratory" / name), open_recording(tmp_path / name)
        assert list(new.messages()) == list(old.messages()), name
