"""`cogrip replay --verify` as its users type it: exit codes, words, what it leaves."""

import json
import re
from pathlib import Path

import msgspec
import pytest

from cogrip.machine.platform import system
from cogrip.protocol.recording.header import versions_here
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Tick

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import ANNA, BEN, FILES, SERVER, TORN, cut, damage, tick, ticks
from tests.recording_files import rewrite


def test_a_run_that_plays_again(run: Path, cogrip: Cogrip) -> None:
    said, problems = cogrip.texts("replay", run, "--verify")
    assert problems == ""
    for file in FILES:
        what = "steps" if file == SERVER else "ticks"
        assert re.search(
            rf"^{file}: equal, bit for bit: \d+ messages, {ticks(file)} {what}, 0\.4\d\d s$", said, re.MULTILINE
        )
    assert len(said.splitlines()) == 3
    said = cogrip.out("replay", run / BEN, "--verify")
    assert said.startswith(f"{BEN}: equal, bit for bit: ")
    assert len(said.splitlines()) == 1


def test_the_first_difference_is_named_with_time_field_and_both_values(run: Path, cogrip: Cogrip) -> None:
    """The least possible: one force of one tick, in its last bit."""
    values: list[float] = []

    def nudged(record: Tick) -> Tick:
        (force,) = record.force_n
        assert force
        values.extend((force * (1.0 + 2**-52), force))
        return msgspec.structs.replace(record, force_n=(values[0],))

    rewrite(run / ANNA, tick(256, nudged))
    said = cogrip.out("replay", run, "--verify", code=1)
    there, here = (json.dumps(value) for value in values)
    assert f"{ANNA}: differs at 0.250000 s in /anna/tick force_n[0]: recorded {there}, replayed {here}" in said
    assert re.search(rf"^{ANNA}: equal until then: \d+ messages, 25\d ticks, 0\.\d+ s$", said, re.MULTILINE)
    assert f"{BEN}: equal, bit for bit" in said, "the others are compared all the same"
    assert "its end is missing" not in said


def test_the_answer_as_json(run: Path, cogrip: Cogrip) -> None:
    rewrite(run / BEN, tick(100, lambda record: msgspec.structs.replace(record, lost=7)))
    said = cogrip.out("replay", run, "--verify", "--json", "answer.json", code=1)
    assert f"{ANNA}: equal, bit for bit" in said, "beside a file the words are printed"
    problems = cogrip.err("replay", run / ANNA, "--verify", "--json", "none/answer.json", code=1)
    assert "--json none/answer.json: cannot be written" in problems
    answer = cogrip.answer("replay", run, "--verify", code=1)
    assert answer == json.loads(Path("answer.json").read_text())
    assert (answer["exact"], answer["unreadable"]) == (False, [])
    found = {each["file"]: each for each in answer["files"]}
    assert set(found) == set(FILES)
    for file in (ANNA, SERVER):
        assert found[file]["exact"] is True
        assert found[file]["difference"] is None
        assert found[file]["ticks"] == ticks(file)
        assert (found[file]["cut"], found[file]["hole"], found[file]["versions"]) == (False, False, [])
    assert (found[BEN]["exact"], found[BEN]["cut"]) == (False, False)
    difference = found[BEN]["difference"]
    assert difference["time_s"] == pytest.approx(100 / 1024, abs=1e-9)
    assert (difference["topic"], difference["field"], difference["recorded"]) == ("/ben/tick", "lost", "7")


def test_other_versions_are_said_before_not_after(run: Path, cogrip: Cogrip) -> None:
    here = versions_here()
    older = msgspec.structs.replace(here, numpy="1.0.0", machine="riscv64")
    rewrite(run / ANNA, versions=older)
    rewrite(run / SERVER, tick(0, lambda record: record), versions=older)
    said = cogrip.out("replay", run, "--verify")
    lines = said.splitlines()
    words = f"was recorded by other versions: numpy: 1.0.0 -> {here.numpy}; machine: riscv64 -> {here.machine}"
    assert lines[:2] == [f"note: {ANNA} {words}", f"note: {SERVER} {words}"]
    assert all("equal, bit for bit" in line for line in lines[2:])
    (anna,) = [each for each in cogrip.answer("replay", run, "--verify")["files"] if each["file"] == ANNA]
    assert anna["versions"] == [f"numpy: 1.0.0 -> {here.numpy}", f"machine: riscv64 -> {here.machine}"]


def test_a_damaged_chunk_is_a_hole_with_its_times(run: Path, cogrip: Cogrip) -> None:
    damage(run / BEN)
    said = cogrip.out("replay", run, "--verify", code=1)
    assert re.search(
        rf"^{BEN}: equal up to a hole, bit for bit: \d+ messages, \d+ ticks, 0\.\d+ s$", said, re.MULTILINE
    )
    hole = re.search(
        rf"^{BEN}: damaged chunk \(.*\), from (0\.\d+) s to (0\.\d+) s \(\d+ bytes at \d+\): nothing after can be compared$",
        said, re.MULTILINE,
    )  # fmt: skip
    assert hole, said
    assert 0.0 < float(hole[1]) < float(hole[2]) < 0.5
    assert f"{ANNA}: equal, bit for bit" in said


def test_what_was_cut_is_recovered_when_it_is_opened_and_that_is_said(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    before = (run / ANNA).read_bytes()
    said, problems = cogrip.texts("replay", run, "--verify")
    recovered = run / "client-anna.recovered.mcap"
    said_first = rf"^note: {ANNA} was not closed: (\d+) messages over 0\.\d+ s are saved in {recovered}; "
    note = rf"{said_first}{len(TORN)} bytes could not be read$"
    found = re.search(note, problems, re.MULTILINE)
    assert found, problems
    assert int(found[1]) == sum(1 for _ in open_recording(recovered).messages())
    assert "client-anna.recovered.mcap: equal, bit for bit" in said
    assert (run / ANNA).read_bytes() == before
    said, problems = cogrip.texts("replay", run, "--verify")
    assert problems == ""
    said, problems = cogrip.texts("replay", run / ANNA, "--verify")
    assert problems == ""
    assert f"{ANNA}: its end is missing; what is there was compared" in said


def test_what_is_still_being_written_is_read_as_it_is(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    with (run / ANNA).open("rb") as writer:
        system.lock(writer.fileno())
        said, problems = cogrip.texts("replay", run, "--verify")
        assert problems == ""
        assert f"{ANNA}: its end is missing; what is there was compared" in said
        assert not list(run.glob("*.recovered.mcap"))
        assert f"{run / ANNA} is still being written; end its session first" in cogrip.err("recover", run, code=1)
    assert cogrip("recover", run)[0] == 0


def test_an_unreadable_part_is_named_and_the_run_is_not_exact(run: Path, cogrip: Cogrip) -> None:
    (run / BEN).write_bytes(b"something else")
    said = cogrip.out("replay", run, "--verify", code=1)
    assert f"note: {run / BEN} is not a recording" in said
    assert f"{ANNA}: equal, bit for bit" in said
    answer = cogrip.answer("replay", run, "--verify", code=1)
    assert (answer["exact"], answer["unreadable"]) == (False, [str(run / BEN)])
    assert {each["file"]: each["exact"] for each in answer["files"]} == {ANNA: True, SERVER: True}
