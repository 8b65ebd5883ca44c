"""`cogrip recover` as its users type it: exit codes, words, what it leaves."""

import re
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.recording.reader import open_recording

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import ANNA, BEN, SERVER, TORN, cut, damage


def test_recover_a_file(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    said, problems = cogrip.texts("recover", run / ANNA)
    assert problems == ""
    recovered = run / "client-anna.recovered.mcap"
    assert re.fullmatch(
        rf"{ANNA} was not closed: \d+ messages over 0\.\d+ s are saved in {recovered}; {len(TORN)} bytes could not be read\n",
        said,
    )
    header = open_recording(run / ANNA).header
    assert header.cut is False
    assert open_recording(recovered).header == msgspec.structs.replace(header, cut=True)
    (verdict,) = cogrip.answer("replay", recovered, "--verify")["files"]
    assert (verdict["exact"], verdict["cut"]) == (True, True)
    damage(run / BEN)  # in the middle alone: it was closed, so its end is all there
    assert cogrip("recover", run / BEN)[0] == 0
    assert open_recording(run / "client-ben.recovered.mcap").header == open_recording(run / BEN).header


def test_recover_a_run_saves_each_file_that_was_cut(run: Path, cogrip: Cogrip) -> None:
    for file in (ANNA, SERVER):
        cut(run / file)
    said = cogrip.out("recover", run)
    assert [line.partition(" ")[0] for line in said.splitlines()] == [ANNA, SERVER]
    saved = {path.name for path in run.glob("*.recovered.mcap")}
    assert saved == {"client-anna.recovered.mcap", "server.recovered.mcap"}
    assert "every recording was closed; there is nothing to recover" in cogrip.out("recover", run)


def test_files_that_are_recovered_already_or_no_recordings_are_refused(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    Path("empty").mkdir()
    assert cogrip("recover", run / ANNA)[0] == 0
    recovered = run / "client-anna.recovered.mcap"
    kept = recovered.read_bytes()
    cogrip.refuses(f"{recovered} exists already; remove it to recover anew", "recover", run / ANNA)
    cogrip.refuses("is not a recording (no MCAP file)", "recover", run / "settings.json")
    cogrip.refuses("empty holds no recording; name a run folder or a .mcap file", "recover", "empty")
    assert recovered.read_bytes() == kept


@pytest.mark.parametrize("size_bytes", [20, 200])
def test_a_file_that_ends_within_its_header_cannot_be_recovered(run: Path, cogrip: Cogrip, size_bytes: int) -> None:
    (run / ANNA).write_bytes((run / ANNA).read_bytes()[:size_bytes])
    cogrip.refuses("ends before it says what it is; nothing of it can be saved", "recover", run / ANNA)
    said, problems = cogrip.texts("replay", run, "--verify", code=1)
    assert "nothing of it can be saved" in said + problems
    assert f"{BEN}: equal, bit for bit" in said
