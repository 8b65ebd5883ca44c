"""Recordings of several machines on one clock: a laboratory run taken apart, each client's clock set off by a known amount."""

import json
import shutil
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.recording.header import Header
from cogrip.protocol.recording.reader import RecordedMessage, RecordingError, open_recording
from cogrip.protocol.recording.records import Clock, kind_of
from cogrip.protocol.recording.recover import recover
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.records import End, open_run
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.merge import merge

from tests.recording_files import rewrite, written

MS = 1_000_000
EPOCH_NS = 1_700_000_000 * 10**9  # of UTC
BOOT_NS = 10**15  # what the server's steady clock says at the laboratory's time 0
DELAY_UP_MS, DELAY_DOWN_MS = 15.0, 5.0
ANCHORS_AT = (10, 100, 200)  # after so many messages
LIVE = Path(__file__).resolve().parents[1] / "recordings" / "live"
SERVER, ANNA, BEN = "server.mcap", "client-anna.mcap", "client-ben.mcap"


TABLE: dict[str, Any] = {
    "name": "merged",
    "seconds": 0.5,
    "link": {"jitter_ms": 2, "loss": 0.05, "up": {"delay_ms": DELAY_UP_MS}, "down": {"delay_ms": DELAY_DOWN_MS}},
    "users": [{"name": "anna"}, {"name": "ben", "hand": "hold"}],
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run as one machine recorded it: more delay up than down, some of it lost."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    folder.mkdir()
    run_laboratory(resolve(TABLE), folder)
    return folder


@dataclass(frozen=True)
class Machine:
    """Differences of a machine's clocks from the server's.

    ahead_ns  its steady clock - the server's
    lie_ns    its UTC - the server's UTC
    anchored  True if it recorded both clocks together
    """

    ahead_ns: int = 0
    lie_ns: int = 0
    anchored: bool = True


def moved(source: Path, target: Path, machine: Machine) -> None:
    """Write a recording as this machine would have made it. The hello and welcome, that had no delay, are left out."""
    recording = open_recording(source)
    clock = next(number for number, topic in enumerate(recording.topics) if kind_of(topic) == "clock")
    header: Header = msgspec.structs.replace(
        recording.header, epoch_ns=EPOCH_NS - BOOT_NS - machine.ahead_ns + machine.lie_ns, virtual=False
    )
    target.parent.mkdir(parents=True, exist_ok=True)
    with written(target, header) as writer:
        for number, message in enumerate(recording.messages()):
            now_ns = message.time_ns + BOOT_NS + machine.ahead_ns
            if machine.anchored and number in ANCHORS_AT:
                utc_ns = message.time_ns + EPOCH_NS + machine.lie_ns
                writer.put(clock, now_ns, encode(Clock(now_ns, utc_ns)))
            if message.time_ns > 0 or not kind_of(recording.topics[message.topic]).startswith("datagram"):
                writer.put(message.topic, now_ns, message.payload)


def parts(whole: Path, base: Path, anna: Machine, ben: Machine, server: Machine = Machine()) -> list[Path]:
    """Return the run in three folders of three machines."""
    folders = [base / name for name in ("the server's", "anna's", "ben's")]
    for folder, file, machine in zip(folders, (SERVER, ANNA, BEN), (server, anna, ben), strict=True):
        moved(whole / file, folder / file, machine)
    shutil.copy2(whole / "settings.json", folders[0])
    shutil.copy2(whole / "summary.json", folders[0])
    return folders


@pytest.fixture
def alike(whole: Path, tmp_path: Path) -> list[Path]:
    """The run of three machines whose clocks show the same, in their folders."""
    return parts(whole, tmp_path, Machine(), Machine())


def datagrams(end: End, kind: str) -> dict[bytes, float]:
    """Return the time at which each datagram first passed, by its bytes."""
    found: dict[bytes, float] = {}
    for timed in end.records(kind):
        found.setdefault(timed.record.data, timed.time_s)
    return found


# The clocks ----------------------------------------------------------------------------------------------------------


def test_three_machines_come_onto_one_clock_and_are_read_as_one_run(whole: Path, tmp_path: Path) -> None:
    """Clock anchors that hold are right to the nanosecond, whatever the machines' clocks show."""
    folders = parts(whole, tmp_path, Machine(ahead_ns=-987_654_321_987_654), Machine(ahead_ns=123_456_789))
    out = tmp_path / "merged"
    found = {each.file: each for each in merge(folders, out)}
    assert {name: each.add_ns for name, each in found.items()} == {ANNA: 987_654_321_987_654, BEN: -123_456_789}
    for each in found.values():
        assert each.by == "clock anchors"
        assert each.least_ns <= each.add_ns <= each.most_ns
        assert each.most_ns - each.least_ns <= (DELAY_UP_MS + DELAY_DOWN_MS + 2.0) * MS, (
            "a tick in each direction, and jitter"
        )
    assert json.loads((out / "clocks.json").read_text()) == {
        name: {"add_ns": each.add_ns, "least_ns": each.least_ns, "most_ns": each.most_ns, "by": each.by}
        for name, each in found.items()
    }
    one, other = open_run(whole), open_run(out)
    assert other.names() == ["anna", "ben"]
    for name, end in one.clients.items():
        ticks, again = (each.columns("tick", "position_m") for each in (end, other.clients[name]))
        assert again["time_s"] == pytest.approx(ticks["time_s"], abs=1e-6)
        assert np.array_equal(again["position_m"], ticks["position_m"])
    steps = [[timed.time_s for timed in run.steps()] for run in (one, other)]
    assert steps[1] == pytest.approx(steps[0], abs=1e-6)
    ends = [(end, other.clients[name]) for name, end in one.clients.items()] + [(one.server, other.server)]
    for (end, moved_end), kind in product(ends, ("datagram_in", "datagram_out")):
        before, after = datagrams(end, kind), datagrams(moved_end, kind)
        assert len(before) - 4 <= len(after) > 50, "all but hello, welcome and what was sent at time 0"
        assert list(after.values()) == pytest.approx([before[data] for data in after], abs=1e-6)


@settings(max_examples=40)
@given(
    ahead_ns=st.integers(-(10**15) + 10**9, 10**15),
    lie_ns=st.one_of(st.integers(-30 * MS, 30 * MS), st.integers(-(10**15), 10**15)),
    server_ahead_ns=st.integers(0, 10**12),
    anchored=st.booleans(),
)
def test_the_truth_is_within_the_bounds_and_anchors_are_taken_when_they_are(
    whole: Path,
    tmp_path_factory: pytest.TempPathFactory,
    ahead_ns: int,
    lie_ns: int,
    server_ahead_ns: int,
    anchored: bool,
) -> None:
    base = tmp_path_factory.mktemp("parts")
    server = Machine(ahead_ns=server_ahead_ns)
    folders = parts(whole, base, Machine(ahead_ns, lie_ns, anchored), Machine(), server)
    (anna, _) = merge(folders, base / "out")
    truth_ns = server_ahead_ns - ahead_ns
    assert anna.least_ns <= truth_ns <= anna.most_ns
    assert truth_ns - anna.least_ns == pytest.approx(DELAY_DOWN_MS * MS, abs=5 * MS)
    assert anna.most_ns - truth_ns == pytest.approx(DELAY_UP_MS * MS, abs=5 * MS)
    middle_ns = (anna.least_ns + anna.most_ns) // 2
    said_ns = truth_ns + lie_ns
    if not anchored:
        assert (anna.by, anna.add_ns) == ("datagrams; there are no clock anchors", middle_ns)
    elif anna.least_ns <= said_ns <= anna.most_ns:
        assert (anna.by, anna.add_ns) == ("clock anchors", said_ns)
    else:
        out_ns = min(abs(said_ns - anna.least_ns), abs(said_ns - anna.most_ns))
        words = f"datagrams; the machines' UTC clocks are out by {out_ns * 1e-6:.1f} ms or more"
        assert (anna.by, anna.add_ns) == (words, middle_ns)
        assert abs(anna.add_ns - truth_ns) <= (anna.most_ns - anna.least_ns) / 2 + 1


@pytest.mark.parametrize("outside_ns", [0, 1])
@pytest.mark.parametrize("side", ["least_ns", "most_ns"])
def test_both_sides_of_both_bounds(whole: Path, alike: list[Path], tmp_path: Path, side: str, outside_ns: int) -> None:
    (anna, _) = merge(alike, tmp_path / "out")
    bound_ns = getattr(anna, side)
    lie_ns = bound_ns + (outside_ns if bound_ns > 0 else -outside_ns)
    (lying, _) = merge(parts(whole, tmp_path / "2", Machine(lie_ns=lie_ns), Machine()), tmp_path / "out 2")
    assert lying.by.startswith("datagrams; the machines' UTC clocks are out by" if outside_ns else "clock anchors")


def test_one_wrong_anchor_among_many_is_outvoted(whole: Path, tmp_path: Path) -> None:
    """A machine whose UTC is set right while it records: the median is taken."""
    folders = parts(whole, tmp_path, Machine(ahead_ns=77 * MS), Machine())
    off_ns = iter([10**12, *[0] * len(ANCHORS_AT)])  # the first one is wrong

    def wrong(kind: str, message: RecordedMessage) -> bytes:
        if kind != "clock":
            return message.payload
        anchor = msgspec.json.decode(message.payload, type=Clock)
        return encode(Clock(anchor.monotonic_ns, anchor.utc_ns + next(off_ns)))

    rewrite(folders[1] / ANNA, wrong)
    (anna, _) = merge(folders, tmp_path / "out")
    assert (anna.by, anna.add_ns) == ("clock anchors", -77 * MS)


# The files -----------------------------------------------------------------------------------------------------------


def test_everything_is_copied_and_nothing_is_changed(whole: Path, tmp_path: Path) -> None:
    folders = parts(whole, tmp_path, Machine(ahead_ns=MS), Machine())
    (folders[1] / "summary.json").write_text('{"of": "anna alone"}')
    before = {path: path.read_bytes() for folder in folders for path in folder.iterdir()}
    out = tmp_path / "a" / "new" / "folder"
    merge(folders[::-1], out)  # the server's part need not come first
    assert {path.name for path in out.iterdir()} == {SERVER, ANNA, BEN, "clocks.json", "settings.json", "summary.json"}
    for path, data in before.items():
        assert path.read_bytes() == data
        if path != folders[1] / "summary.json":  # the server's knows of all
            assert (out / path.name).read_bytes() == data


def test_files_are_named_one_by_one_and_those_of_the_servers_machine_stay_on_its_clock(
    whole: Path, tmp_path: Path
) -> None:
    """A part may be missing."""
    server, anna, ben = parts(whole, tmp_path, Machine(), Machine(ahead_ns=9 * MS))
    (found,) = merge([server / SERVER, ben / BEN], tmp_path / "alone")
    assert (found.file, found.add_ns) == (BEN, -9 * MS)
    assert open_run(tmp_path / "alone").names() == ["anna", "ben"]
    (anna / ANNA).rename(server / ANNA)
    found = {each.file: each.add_ns for each in merge([server, ben], tmp_path / "out")}
    assert found == {ANNA: 0, BEN: -9 * MS}


def test_a_part_that_was_cut_off_is_merged_and_its_recovery_keeps_the_clock(whole: Path, tmp_path: Path) -> None:
    folders = parts(whole, tmp_path, Machine(ahead_ns=10**14), Machine())
    data = (folders[1] / ANNA).read_bytes()
    (folders[1] / ANNA).write_bytes(data[: len(data) * 3 // 4])
    (anna, _) = merge(folders, tmp_path / "out")
    assert (anna.by, anna.add_ns) == ("clock anchors", -(10**14))
    before = open_run(tmp_path / "out").clients["anna"].columns("tick", "tick")
    assert len(before["tick"]) > 100
    recover(tmp_path / "out" / ANNA)
    after = open_run(tmp_path / "out").clients["anna"].columns("tick", "tick")
    assert after["time_s"] == pytest.approx(before["time_s"], abs=1e-6)


# What cannot be merged -----------------------------------------------------------------------------------------------


def refused(folders: list[Path], out: Path, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        merge(folders, out)
    assert not out.exists()


def test_parts_that_are_not_of_one_run_are_refused(alike: list[Path], tmp_path: Path) -> None:
    (server, anna, ben), out = alike, tmp_path / "out"
    again, twice = (Path(shutil.copytree(each, tmp_path / f"{each.name} again")) for each in (server, anna))
    refused([server, LIVE / BEN], out, "have no datagrams in common; they are not of one run")
    refused([server, anna, LIVE / BEN], out, f"{LIVE / BEN} and the server's recording have no datagrams")
    refused([anna, ben], out, "a run has one server, and here is none; name its folder and those of its")
    refused([server, again, anna], out, f"here is {server / SERVER}, {again / SERVER}")
    refused([server, anna, ben, twice], out, "'anna' is recorded 2 times; merge the parts of one run only")
    rewrite(anna / ANNA, lambda kind, message: message.payload if kind != "datagram_in" else None)
    refused([server, anna], out, "have no datagrams in common")  # bounds need both directions


def test_what_exists_is_not_overwritten_and_what_is_no_run_is_named(alike: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(FileNotFoundError, match="nowhere: there is no such run"):
        merge([alike[0], tmp_path / "nowhere"], out)
    out.mkdir()
    with pytest.raises(FileExistsError):
        merge(alike, out)
    out.rmdir()  # nothing is in it
    (tmp_path / "server.mcap").write_bytes(b"not a recording")
    refused([tmp_path, alike[0]], out, "is not a recording")


def test_one_file_that_is_found_twice_is_one_file(whole: Path, tmp_path: Path) -> None:
    """A server of several rooms records above their folders; each of them finds it."""
    moved(whole / SERVER, tmp_path / "runs" / SERVER, Machine())
    for name, file in (("room 1", ANNA), ("room 2", BEN)):
        moved(whole / file, tmp_path / "runs" / name / file, Machine())
    found = merge([tmp_path / "runs" / "room 1", tmp_path / "runs" / "room 2"], tmp_path / "out")
    assert [each.file for each in found] == [ANNA, BEN]


def test_files_of_one_name_are_not_copied_over_each_other(alike: list[Path], tmp_path: Path) -> None:
    server, anna, ben = alike
    (anna / ANNA).rename(anna / "client.mcap")
    (ben / BEN).rename(ben / "client.mcap")
    words = r"there are several files client\.mcap; rename all but one, so that none is written over another"
    refused([server, anna, ben], tmp_path / "out", words)
    (ben / "client.mcap").rename(ben / BEN)
    merge([server, anna, ben], tmp_path / "out")
    assert set(open_run(tmp_path / "out").clients) == {"anna", "ben"}
