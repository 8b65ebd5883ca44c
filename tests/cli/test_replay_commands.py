"""`cogrip replay`, `recover` and `merge` as their users type them: exit codes, words, what they leave."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.cli import join
from cogrip.cli.main import main
from cogrip.cli.problem import BadInput
from cogrip.devices import Device
from cogrip.protocol.io.recorder import lock
from cogrip.protocol.messages import Hello
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import Message, open_recording
from cogrip.protocol.recording.records import Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.recording.writer import RecordingWriter
from cogrip.protocol.settings import resolve
from cogrip.sim.lab_run import run_laboratory
from cogrip.sim.records import open_run

LIVE = Path(__file__).resolve().parents[1] / "recordings" / "live"
SERVER, ANNA, BEN = "server.mcap", "client-anna.mcap", "client-ben.mcap"
FILES = (ANNA, BEN, SERVER)
TORN = b"\x06\x00\x10\x00\x00\x00\x00\x00\x00 the writer came no further"  # a chunk of 4096 bytes begins
TABLE: dict[str, Any] = {
    "name": "pair",
    "seconds": 0.5,
    "link": {"delay_ms": 10, "loss": 0.1},
    "playout": {"frames": 2},
    "users": [{"name": "anna"}, {"name": "ben", "device": "sim:ideal", "hand": "hold"}],
}


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded")
    run_laboratory(resolve(TABLE), folder)
    return folder


@pytest.fixture
def run(recorded: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy to spoil, in the present folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "300")
    shutil.copytree(recorded, tmp_path / "run")
    return Path("run")


@pytest.fixture
def cogrip(capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Run one command: exit code, what it said, what it said of problems."""

    def command(*arguments: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return command


Cogrip = Callable[..., tuple[int, str, str]]
Alter = Callable[[str, Message], bytes | None]


def same(kind: str, message: Message) -> bytes | None:
    return message.payload


def rewrite(path: Path, alter: Alter = same, closed: bool = True, **header: object) -> None:
    """Write a recording anew: other payloads (None leaves a message out), other fields of the header, perhaps not closed."""
    recording = open_recording(path)
    messages = list(recording.messages())
    new: Header = msgspec.structs.replace(recording.header, **header)
    with path.open("wb") as file:
        writer = RecordingWriter(file, new)
        for message in messages:
            payload = alter(kind_of(recording.topics[message.topic]), message)
            if payload is not None:
                writer.put(message.topic, message.time_ns, payload)
        if closed:
            writer.finish()
        else:
            writer.flush()


def until(last_ns: int) -> Alter:
    """Leave out what came later."""
    return lambda kind, message: message.payload if message.time_ns <= last_ns else None


def tick(number: int, change: Callable[[Tick], Tick]) -> Alter:
    """Change one tick."""

    def alter(kind: str, message: Message) -> bytes | None:
        if kind == "tick":
            record = msgspec.json.decode(message.payload, type=Tick)
            if record.tick == number:
                return encode(change(record))
        return message.payload

    return alter


def cut(path: Path) -> None:
    """End a file within its last chunk, after a tick."""
    rewrite(path, until(300_000_000), closed=False)
    with path.open("ab") as file:
        file.write(TORN)


def damage(path: Path) -> None:
    """Spoil a chunk in the middle."""
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 100] = bytes(100)
    path.write_bytes(data)


def ticks(file: str) -> int:
    return 64 if file == SERVER else 512


# Replay, to verify ---------------------------------------------------------------------------------------------------


def test_a_run_that_plays_again(run: Path, cogrip: Cogrip) -> None:
    code, said, problems = cogrip("replay", run, "--verify")
    assert (code, problems) == (0, "")
    for file in FILES:
        what = "steps" if file == SERVER else "ticks"
        assert re.search(
            rf"^{file}: equal, bit by bit: \d+ messages, {ticks(file)} {what}, 0\.4\d\d s$", said, re.MULTILINE
        )
    assert len(said.splitlines()) == 3


def test_one_file_alone(run: Path, cogrip: Cogrip) -> None:
    code, said, _ = cogrip("replay", run / BEN, "--verify")
    assert code == 0
    assert said.startswith(f"{BEN}: equal, bit by bit: ")
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
    code, said, _ = cogrip("replay", run, "--verify")
    assert code == 1
    there, here = (json.dumps(value) for value in values)
    assert f"{ANNA}: differs at 0.250000 s in /anna/tick force_n[0]: recorded {there}, replayed {here}" in said
    assert re.search(rf"^{ANNA}: equal until then: \d+ messages, 25\d ticks, 0\.\d+ s$", said, re.MULTILINE)
    assert f"{BEN}: equal, bit by bit" in said, "the others are compared all the same"


def test_another_input_makes_another_run(run: Path, cogrip: Cogrip) -> None:
    """A position is an input; what differs is what came of it, in that tick or a later one."""
    rewrite(
        run / ANNA,
        tick(201, lambda record: msgspec.structs.replace(record, position_m=(0.001,))),
    )
    code, said, _ = cogrip("replay", run / ANNA, "--verify")
    assert code == 1
    assert "differs at 0.196289 s in /anna/tick velocity_mps[0]: recorded" in said


def test_a_closed_file_that_differs_was_closed(run: Path, cogrip: Cogrip) -> None:
    rewrite(run / ANNA, tick(100, lambda record: msgspec.structs.replace(record, lost=7)))
    assert "was not closed" not in cogrip("replay", run, "--verify")[1]
    (anna,) = json.loads(cogrip("replay", run / ANNA, "--verify", "--json", "-")[1])["files"]
    assert anna["cut"] is False


@pytest.mark.parametrize("kind", ["datagram_in", "datagram_out"])
def test_a_missing_message_is_a_difference(run: Path, cogrip: Cogrip, kind: str) -> None:
    seen = 0

    def without_one(this: str, message: Message) -> bytes | None:
        nonlocal seen
        seen += this == kind
        return None if this == kind and seen == 20 else message.payload

    rewrite(run / ANNA, without_one)
    code, said, _ = cogrip("replay", run / ANNA, "--verify")
    assert code == 1
    assert f"{ANNA}: differs at " in said


def test_the_answer_as_json(run: Path, cogrip: Cogrip) -> None:
    rewrite(run / BEN, tick(100, lambda record: msgspec.structs.replace(record, lost=7)))
    code, said, _ = cogrip("replay", run, "--verify", "--json", "-")
    assert code == 1
    answer = json.loads(said)
    assert (answer["exact"], answer["unreadable"]) == (False, [])
    found = {each["file"]: each for each in answer["files"]}
    assert set(found) == set(FILES)
    for file in (ANNA, SERVER):
        assert found[file]["exact"] is True
        assert found[file]["difference"] is None
        assert found[file]["ticks"] == ticks(file)
        assert (found[file]["cut"], found[file]["hole"], found[file]["versions"]) == (False, False, [])
    assert found[BEN]["exact"] is False
    difference = found[BEN]["difference"]
    assert difference["time_s"] == pytest.approx(100 / 1024, abs=1e-9)
    assert (difference["topic"], difference["field"], difference["recorded"]) == ("/ben/tick", "lost", "7")


def test_json_into_a_file(run: Path, cogrip: Cogrip) -> None:
    code, said, _ = cogrip("replay", run, "--verify", "--json", "answer.json")
    assert code == 0
    assert "equal, bit by bit" in said
    assert json.loads(Path("answer.json").read_text())["exact"] is True
    code, _, problems = cogrip("replay", run, "--verify", "--json", "none/answer.json")
    assert code == 1
    assert "--json none/answer.json: cannot be written" in problems


def test_other_versions_are_said_before_not_after(run: Path, cogrip: Cogrip) -> None:
    here = versions_here()
    older = msgspec.structs.replace(here, numpy="1.0.0", machine="riscv64")
    rewrite(run / ANNA, versions=older)
    rewrite(run / SERVER, tick(0, lambda record: record), versions=older)
    code, said, _ = cogrip("replay", run, "--verify")
    assert code == 0
    lines = said.splitlines()
    words = f"was recorded by other versions: numpy: 1.0.0 -> {here.numpy}; machine: riscv64 -> {here.machine}"
    assert lines[:2] == [f"note: {ANNA} {words}", f"note: {SERVER} {words}"]
    assert all("equal, bit by bit" in line for line in lines[2:])
    _, said, _ = cogrip("replay", run, "--verify", "--json", "-")
    (anna,) = [each for each in json.loads(said)["files"] if each["file"] == ANNA]
    assert anna["versions"] == [f"numpy: 1.0.0 -> {here.numpy}", f"machine: riscv64 -> {here.machine}"]


def test_a_damaged_chunk_is_a_hole_with_its_times(run: Path, cogrip: Cogrip) -> None:
    damage(run / BEN)
    code, said, _ = cogrip("replay", run, "--verify")
    assert code == 1
    assert re.search(rf"^{BEN}: equal up to a hole, bit by bit: \d+ messages, \d+ ticks, 0\.\d+ s$", said, re.MULTILINE)
    hole = re.search(
        rf"^{BEN}: damaged chunk \(.*\), from (0\.\d+) s to (0\.\d+) s \(\d+ bytes at \d+\): nothing after can be compared$",
        said, re.MULTILINE,
    )  # fmt: skip
    assert hole, said
    assert 0.0 < float(hole[1]) < float(hole[2]) < 0.5
    assert f"{ANNA}: equal, bit by bit" in said


def test_what_was_cut_is_recovered_when_it_is_opened_and_that_is_said(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    before = (run / ANNA).read_bytes()
    code, said, problems = cogrip("replay", run, "--verify")
    assert code == 0
    recovered = run / "client-anna.recovered.mcap"
    said_first = rf"^note: {ANNA} was not closed: (\d+) messages over 0\.\d+ s are saved in {recovered}; "
    note = rf"{said_first}{len(TORN)} bytes could not be read$"
    found = re.search(note, problems, re.MULTILINE)
    assert found, problems
    assert int(found[1]) == sum(1 for _ in open_recording(recovered).messages())
    assert "client-anna.recovered.mcap: equal, bit by bit" in said
    assert (run / ANNA).read_bytes() == before
    code, said, problems = cogrip("replay", run, "--verify")  # it is not done twice
    assert (code, problems) == (0, "")
    code, said, problems = cogrip("replay", run / ANNA, "--verify")  # the old file can still be named
    assert (code, problems) == (0, "")
    assert f"{ANNA}: was not closed; what is there was compared" in said


def test_what_is_still_being_written_is_read_as_it_is(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    with (run / ANNA).open("rb") as writer:
        lock(writer.fileno())
        code, said, problems = cogrip("replay", run, "--verify")
        assert (code, problems) == (0, "")
        assert f"{ANNA}: was not closed; what is there was compared" in said
        assert not list(run.glob("*.recovered.mcap"))
        code, _, problems = cogrip("recover", run)
        assert code == 1
        assert f"{run / ANNA} is still being written; end its session first" in problems
    assert cogrip("recover", run)[0] == 0


def test_a_part_that_cannot_be_read_is_named(run: Path, cogrip: Cogrip) -> None:
    (run / BEN).write_bytes(b"something else")
    code, said, _ = cogrip("replay", run, "--verify")
    assert code == 1
    assert f"note: {run / BEN} is not a recording" in said
    assert f"{ANNA}: equal, bit by bit" in said


def test_a_run_with_a_part_that_cannot_be_read_is_not_exact(run: Path, cogrip: Cogrip) -> None:
    (run / BEN).write_bytes(b"something else")
    code, said, _ = cogrip("replay", run, "--verify", "--json", "-")
    assert code == 1
    answer = json.loads(said)
    assert answer["exact"] is False
    assert answer["unreadable"] == [str(run / BEN)]
    assert {each["file"]: each["exact"] for each in answer["files"]} == {ANNA: True, SERVER: True}


# Replay, what if -----------------------------------------------------------------------------------------------------


def test_another_world_leaves_a_run_and_a_comparison(run: Path, cogrip: Cogrip) -> None:
    code, said, _ = cogrip("replay", run, "--what-if", "--set", "coupling.stiffness_npm=300", "--runs", "other")
    assert code == 0
    (folder,) = Path("other").iterdir()
    assert folder.name.endswith("-pair-what-if")
    left = {path.name for path in folder.iterdir()}
    assert left >= {*FILES, "settings.json", "summary.json", "report.html", "comparison.html"}
    assert json.loads((folder / "settings.json").read_text())["coupling"]["stiffness_npm"] == 300.0
    assert f"comparison: {folder / 'comparison.html'}" in said
    assert "what if coupling.stiffness_npm = 300" in said
    assert "as recorded" in said
    assert "peak force [N]" in said
    page = (folder / "comparison.html").read_text()
    assert "as recorded" in page
    assert "what if coupling.stiffness_npm = 300" in page
    assert cogrip("replay", folder, "--verify")[0] == 0


def test_an_unchanged_world_is_the_recorded_one(run: Path, cogrip: Cogrip) -> None:
    assert cogrip("replay", run, "--what-if", "--runs", "other")[0] == 0
    (folder,) = Path("other").iterdir()
    for file in FILES:
        assert list(open_recording(folder / file).messages()) == list(open_recording(run / file).messages())
    before, after = (json.loads((each / "summary.json").read_text()) for each in (run, folder))
    assert before == after


@pytest.mark.parametrize(
    ("hands", "device"), [("impedance", "sim:ideal"), ("positions", "replay:run#user=ben"), ("same", "sim:ideal")]
)
def test_how_the_hands_take_part(run: Path, cogrip: Cogrip, hands: str, device: str) -> None:
    assert cogrip("replay", run, "--what-if", "--hands", hands, "--set", "object.mass_kg=1", "--runs", "other")[0] == 0
    (folder,) = Path("other").iterdir()
    ben = json.loads((folder / "settings.json").read_text())["users"][1]
    assert ben["device"] == device
    assert ben["hand"] == ("recording:run#user=ben" if hands == "impedance" else "hold")


def test_beside_a_live_run_stands_what_the_laboratory_changes_by_itself(run: Path, cogrip: Cogrip) -> None:
    code, said, _ = cogrip("replay", LIVE, "--what-if", "--set", "link.delay_ms=5", "--runs", "other")
    assert code == 0
    for words in ("as recorded", "unchanged, in the laboratory", "what if link.delay_ms = 5"):
        assert words in said
    (folder,) = Path("other").iterdir()
    assert open_run(folder / "unchanged").settings() is not None
    assert {path.name for path in LIVE.iterdir()} == {*FILES, "settings.json", "summary.json"}, "nothing is left there"


# Bad input -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run",), "say either --verify or --what-if"),
        (("run", "--verify", "--what-if"), "say either --verify or --what-if"),
        (("run", "--verify", "--set", "seed=2"), "--set changes the world, so it goes with --what-if"),
        (("run", "--what-if", "--json", "-"), "--json goes with --verify"),
        (("nowhere", "--verify"), "nowhere: there is no such run; name a run folder or a .mcap file"),
        (("run/settings.json", "--verify"), "is not a recording (no MCAP file); name a run folder or its .mcap file"),
        (("empty", "--verify"), "empty holds no recording that can be read"),
        (("run", "--what-if", "--set", "coupling.impedence_nspm=50"), "did you mean coupling.impedance_nspm?"),
        (("run", "--what-if", "--set", "nonsense"), "section.key=value"),
        (("run", "--what-if", "--set", "coupling.impedance_nspm=-1"), "coupling.impedance_nspm = -1"),
        (("run", "--what-if", "--set", "users.0.device=sim:phantm"), "sim:phantm"),
        (("run", "--what-if", "--hands", "impedance", "--set", "rates.device_hz=2048"), "was recorded at 1024 Hz"),
        (("run", "--what-if", "--hands", "both"), "both"),
        (
            ("run", "--what-if", "--set", "object.axes=3", "--hands", "positions"),
            "was recorded on 1 axes, 3 are asked for",
        ),
        (("run/client-anna.mcap", "--what-if"), "holds no recording of the server"),
        (("run", "--what-if", "--runs", "/proc/x"), "no folder can be made there"),
    ],
)
def test_bad_input_is_named_and_nothing_is_left(
    run: Path, cogrip: Cogrip, arguments: tuple[str, ...], words: str
) -> None:
    Path("empty").mkdir()
    before = sorted(Path().rglob("*"))
    code, said, problems = cogrip("replay", *arguments)
    assert code == 2
    assert words in problems + said
    assert sorted(Path().rglob("*")) == before


def test_a_person_who_is_missing_is_named(run: Path, cogrip: Cogrip) -> None:
    (run / BEN).unlink()
    code, _, problems = cogrip("replay", run, "--what-if", "--set", "seed=2", "--runs", "other")
    assert code == 2
    assert "run holds no recording of 'ben'; there is: anna" in problems
    assert not Path("other").exists()


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ({"format": 2}, "is a recording of format 2, newer than 1, the newest known here; update cogrip"),
        ({"start": "{}"}, "cannot be replayed"),
        ({"start": "no JSON"}, "cannot be replayed"),
        ({"role": "spectator"}, "is of a 'spectator'; only client and server can be replayed"),
    ],
)
def test_files_that_cannot_be_replayed_say_why(run: Path, cogrip: Cogrip, header: dict[str, Any], words: str) -> None:
    rewrite(run / ANNA, **header)
    code, said, problems = cogrip("replay", run / ANNA, "--verify")
    assert code == 2
    assert words in problems, said


@pytest.mark.parametrize("start", ["{}", "no JSON"])
@pytest.mark.parametrize(("file", "what"), [(SERVER, "its settings"), (ANNA, "what device was recorded")])
def test_a_header_that_cannot_be_read_is_bad_input_for_what_if(
    run: Path, cogrip: Cogrip, file: str, what: str, start: str
) -> None:
    rewrite(run / file, start=start)
    code, _, problems = cogrip("replay", run, "--what-if", "--runs", "other")
    assert code == 2
    assert f"{run / file} does not say {what}: " in problems
    assert not Path("other").exists()


@pytest.mark.parametrize(
    ("device", "more", "words"),
    [
        ("replay:nowhere", (), "there is no such run; name a run folder or a .mcap file"),
        ("replay:nowhere", ("--axes", 1), "there is no such run; name a run folder or a .mcap file"),
        ("replay:run#user=cleo", (), "no recording of user cleo; there is: 0 (anna), 1 (ben)"),
        ("replay:run#user=cleo", ("--axes", 1), "no recording of user cleo; there is: 0 (anna), 1 (ben)"),
        ("replay:run#user=anna", ("--axes", 3), "was recorded on 1 axes, 3 are asked for"),
    ],
)
def test_joining_with_a_replay_that_cannot_be_played(
    run: Path, cogrip: Cogrip, device: str, more: tuple[object, ...], words: str
) -> None:
    code, _, problems = cogrip("join", "127.0.0.1:1", "--device", device, *more)
    assert code == 2
    assert words in problems


@pytest.mark.parametrize(
    ("device", "more", "axes"),
    [("replay:run#user=anna", (), 1), ("replay:run#user=anna", ("--axes", 1), 1), ("sim:ideal", (), 3)],
)
def test_joining_takes_the_axes_that_were_recorded(
    run: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, device: str, more: tuple[object, ...], axes: int
) -> None:
    """What goes to the server, looked at where it would go out."""
    asked: list[tuple[int, int]] = []

    def client(arm: Device, hello: Hello, *_: object) -> None:
        asked.append((hello.device_axes, arm.capability.axes))
        raise BadInput("nobody is there")

    monkeypatch.setattr(join, "LiveClient", client)
    assert cogrip("join", "127.0.0.1:1", "--device", device, *more)[0] == 2
    assert asked == [(axes, axes)]


# Recover -------------------------------------------------------------------------------------------------------------


def test_recover_a_file(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    code, said, problems = cogrip("recover", run / ANNA)
    assert (code, problems) == (0, "")
    recovered = run / "client-anna.recovered.mcap"
    assert re.fullmatch(
        rf"{ANNA} was not closed: \d+ messages over 0\.\d+ s are saved in {recovered}; {len(TORN)} bytes could not be read\n",
        said,
    )
    header = open_recording(run / ANNA).header
    assert header.cut is False
    assert open_recording(recovered).header == msgspec.structs.replace(header, cut=True)
    code, said, _ = cogrip("replay", recovered, "--verify", "--json", "-")
    (verdict,) = json.loads(said)["files"]
    assert (code, verdict["exact"], verdict["cut"]) == (0, True, True)


def test_recover_a_file_that_is_damaged_in_the_middle_alone(run: Path, cogrip: Cogrip) -> None:
    """It was closed, so its end is all there."""
    damage(run / BEN)
    assert cogrip("recover", run / BEN)[0] == 0
    assert open_recording(run / "client-ben.recovered.mcap").header == open_recording(run / BEN).header


def test_recover_a_run_saves_each_file_that_was_cut(run: Path, cogrip: Cogrip) -> None:
    for file in (ANNA, SERVER):
        cut(run / file)
    code, said, _ = cogrip("recover", run)
    assert code == 0
    assert [line.partition(" ")[0] for line in said.splitlines()] == [ANNA, SERVER]
    assert {path.name for path in run.glob("*.recovered.mcap")} == {
        "client-anna.recovered.mcap",
        "server.recovered.mcap",
    }
    code, said, _ = cogrip("recover", run)
    assert code == 0
    assert "every recording was closed as it should; there is nothing to recover" in said


def test_recover_twice_and_what_is_none(run: Path, cogrip: Cogrip) -> None:
    cut(run / ANNA)
    assert cogrip("recover", run / ANNA)[0] == 0
    kept = (run / "client-anna.recovered.mcap").read_bytes()
    for file, words in (
        (run / ANNA, f"{run / 'client-anna.recovered.mcap'} exists already; remove it to recover anew"),
        (run / "settings.json", "is not a recording (no MCAP file)"),
        (Path("nowhere.mcap"), "nowhere.mcap"),
    ):
        code, _, problems = cogrip("recover", file)
        assert code == 2
        assert words in problems
    assert (run / "client-anna.recovered.mcap").read_bytes() == kept


def test_a_file_of_which_nothing_can_be_saved(run: Path, cogrip: Cogrip) -> None:
    (run / ANNA).write_bytes((run / ANNA).read_bytes()[:20])
    code, _, problems = cogrip("recover", run / ANNA)
    assert code == 2
    assert "ends before it says what it is; nothing of it can be saved" in problems
    code, said, problems = cogrip("replay", run, "--verify")
    assert "nothing of it can be saved" in said + problems
    assert f"{BEN}: equal, bit by bit" in said


def test_a_file_that_ends_within_its_header_ends_before_it_says_what_it_is(run: Path, cogrip: Cogrip) -> None:
    (run / ANNA).write_bytes((run / ANNA).read_bytes()[:200])
    code, _, problems = cogrip("recover", run / ANNA)
    assert code == 2
    assert "ends before it says what it is; nothing of it can be saved" in problems


def test_recover_says_that_there_is_no_recording(run: Path, cogrip: Cogrip) -> None:
    Path("empty").mkdir()
    code, said, problems = cogrip("recover", "empty")
    assert code == 2
    assert "every recording was closed" not in said
    assert "empty holds no recording; name a run folder or a .mcap file" in problems


def test_recover_says_in_words_that_there_is_no_such_file(run: Path, cogrip: Cogrip) -> None:
    code, _, problems = cogrip("recover", "nowhere.mcap")
    assert code == 2
    assert "Errno" not in problems
    assert "nowhere.mcap: there is no such file; name a run folder or a .mcap file" in problems


# Merge ---------------------------------------------------------------------------------------------------------------


@pytest.fixture
def parts(run: Path) -> list[Path]:
    """The run in three folders, as three machines leave it."""
    folders = [Path(name) for name in ("at the server's", "at anna's", "at ben's")]
    for folder, file in zip(folders, (SERVER, ANNA, BEN), strict=True):
        folder.mkdir()
        (run / file).rename(folder / file)
    (run / "settings.json").rename(folders[0] / "settings.json")
    return folders


def test_merge_says_what_it_did(parts: list[Path], cogrip: Cogrip) -> None:
    code, said, problems = cogrip("merge", *parts, "--out", "merged")
    assert (code, problems) == (0, "")
    lines = said.splitlines()
    for file, line in zip((ANNA, BEN), lines, strict=False):
        assert re.fullmatch(
            rf"{file}: [+-]\d+\.\d{{3}} ms to the server's clock, by datagrams; there are no clock anchors "
            r"\(datagrams bound it to ±\d+\.\d ms\)",
            line,
        )
    assert lines[2:] == ["merged: merged; see `cogrip report merged`"]
    assert {path.name for path in Path("merged").iterdir()} == {*FILES, "clocks.json", "settings.json"}
    assert cogrip("replay", "merged", "--verify")[0] == 0


def test_a_merged_run_is_a_run_like_any_other(parts: list[Path], cogrip: Cogrip) -> None:
    assert cogrip("merge", *parts, "--out", "merged")[0] == 0
    assert cogrip("replay", "merged", "--what-if", "--set", "seed=3", "--runs", "other")[0] == 0
    cut(Path("merged") / ANNA)
    code, _, problems = cogrip("replay", "merged", "--verify")
    assert code == 0
    assert "saved in merged/client-anna.recovered.mcap" in problems


def test_a_file_that_is_named_twice_is_one_file(parts: list[Path], cogrip: Cogrip) -> None:
    assert cogrip("merge", *parts, parts[0] / SERVER, "--out", "merged")[0] == 0
    assert cogrip("merge", parts[0], parts[1], parts[1] / ANNA, "--out", "without ben")[0] == 0
    assert cogrip("replay", "merged", "--verify")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("at anna's", "--out", "new"), "name at least two folders, the server's and a client's"),
        (("--out", "new"), "name at least two folders"),
        (("at anna's", "at ben's", "--out", "new"), "a run has one server, and here is none"),
        (("at the server's", "its copy", "at anna's", "--out", "new"), "a run has one server"),
        (("at the server's", "at anna's", "one name", "--out", "new"), "there are several files client-anna.mcap"),
        (("at the server's", "at anna's", "twice", "--out", "new"), "'anna' is recorded 2 times"),
        (("at the server's", "nowhere", "--out", "new"), "nowhere: there is no such run"),
        (("at the server's", "file.txt", "--out", "new"), "file.txt is not a recording"),
        (("at the server's", LIVE / BEN, "--out", "new"), "no datagrams in common; they are not of one run"),
        (("at the server's", "at anna's", "--out", "at ben's"), "--out at ben's exists already; name a new folder"),
        (("at the server's", "at anna's", "--out", "file.txt/new"), "Not a directory"),
        (("at the server's", "at anna's"), "--out"),
    ],
)
def test_what_cannot_be_merged_is_named_and_nothing_is_left(
    parts: list[Path], cogrip: Cogrip, arguments: tuple[object, ...], words: str
) -> None:
    Path("file.txt").write_text("not a recording")
    shutil.copytree("at anna's", "twice")
    shutil.copytree("at the server's", "its copy")
    Path("one name").mkdir()
    shutil.copy2(Path("at ben's") / BEN, Path("one name") / ANNA)
    before = sorted(Path().rglob("*"))
    code, said, problems = cogrip("merge", *arguments)
    assert code == 2
    assert words in said + problems
    assert sorted(Path().rglob("*")) == before
