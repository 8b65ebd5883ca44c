"""Recorded hands with other settings: only what is set changes, and unchanged settings give the recorded run."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.client.recorder import start_of, start_text
from cogrip.devices.device import Capability
from cogrip.devices.for_user import make_for
from cogrip.protocol.recording.reader import RecordedMessage, RecordingError, open_recording
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings, User
from cogrip.protocol.settings.table import SettingsError
from cogrip.protocol.wire.messages import DEVICE_BYTES, Hello
from cogrip.results.comparison.differences import settings_differences
from cogrip.results.reading.records import RunRecords, open_run
from cogrip.results.replay.verify import verify
from cogrip.results.replay.what_if import Hands, WhatIf, folder_name, label, what_if
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.server.recorder import start_of as server_start

from tests.extent import every, long
from tests.recording_files import rewrite

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
LIVE = Path(__file__).resolve().parents[1] / "recordings" / "live"
FILES = ("client-anna.mcap", "client-ben.mcap", "server.mcap")
TABLE: dict[str, Any] = {
    "name": "pair",
    "seed": 5,
    "seconds": 0.625,  # 80 frames
    "object": {"axes": 2},
    "link": {"delay_ms": 12, "jitter_ms": 4, "loss": 0.1},
    "playout": {"frames": 2},
    "users": [
        {"name": "anna", "hand": "reach&direction=1,0.5&hand_stiffness_npm=450&hand_damping_nspm=8"},
        {"name": "ben", "device": "sim:ideal", "hand": "tremor&amplitude_m=0.02&direction=-1,1&seed=4"},
    ],
}


def lab(world: WhatIf | Settings, folder: Path) -> RunRecords:
    """Run it, with recordings in a new folder."""
    folder.mkdir(parents=True)
    settings, begins = (world, ()) if isinstance(world, Settings) else (world.settings, world.begins)
    run_laboratory(settings, folder, begins=begins)
    return open_run(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunRecords:
    """Two people, two machines, two axes, a bad link, half a second."""
    return lab(resolve(TABLE), tmp_path_factory.mktemp("runs") / "first")


@pytest.fixture
def spoiled(run: RunRecords, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(run.folder, tmp_path / "copy"))


def streams(run: RunRecords) -> dict[str, list[RecordedMessage]]:
    """Return every message of every file, by file name."""
    return {path.name: list(open_recording(path).messages()) for path in sorted(run.folder.glob("*.mcap"))}


def differences(one: Settings, other: Settings) -> dict[str, Any]:
    """Return the dotted names of what differs, with the other's value."""
    return {
        row.key: row.values[1] for row in settings_differences([msgspec.to_builtins(one), msgspec.to_builtins(other)])
    }


def with_start(path: Path, alter: Callable[[Hello, Capability], tuple[Hello, Capability]]) -> None:
    """Write a client's recording anew with another start."""
    rewrite(path, start=start_text(*alter(*start_of(open_recording(path).header.start))))


def joined_with(path: Path, device: str) -> None:
    """Write the recording as if this person had joined with another device than the settings name."""
    with_start(path, lambda hello, capability: (msgspec.structs.replace(hello, device=device), capability))


# The same world ------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize("config", every(12, sorted(CONFIGS.glob("*.toml"))), ids=lambda path: path.stem)
def test_the_same_hands_in_the_same_world_are_the_same_run_bit_for_bit(config: Path, tmp_path: Path) -> None:
    first = lab(load(config, ["seconds=1.2"]), tmp_path / "first")
    again = lab(what_if(first, {}), tmp_path / "again")
    assert streams(again) == streams(first)
    assert sum(len(messages) for messages in streams(first).values()) > 2000


@pytest.mark.long
@pytest.mark.parametrize(
    "changes",
    [
        long({"coupling.kind": "coupling"}),
        {"link.loss": 0.4, "link.rate_kbps": 200, "seconds": 0.5},
        {"object.kind": "faces", "seconds": 0.5},
        {"seconds": 0.45},  # 57.6 frames
    ],
)
def test_so_they_are_in_worlds_of_other_kinds(changes: dict[str, Any], tmp_path: Path) -> None:
    first = lab(resolve(TABLE, changes), tmp_path / "first")
    assert streams(lab(what_if(first, {}), tmp_path / "again")) == streams(first)


def positions(run: RunRecords, other: RunRecords) -> Iterator[tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]]:
    """Yield each person's positions in one run, and in another."""
    for name, end in run.clients.items():
        yield (
            end.columns("tick", "position_m")["position_m"],
            other.clients[name].columns("tick", "position_m")["position_m"],
        )


@pytest.mark.long
def test_what_if_of_what_if(run: RunRecords, tmp_path: Path) -> None:
    """The other world is a recorded run like any other, and so can be had again."""
    other = lab(what_if(run, {"object.mass_kg": 1.0}, "impedance"), tmp_path / "other")
    assert streams(lab(what_if(other, {}), tmp_path / "again")) == streams(other)
    back = lab(what_if(other, {"object.mass_kg": 0.2}), tmp_path / "back")
    assert all(np.abs(before - after).max() < 1e-3 for before, after in positions(run, back))


# Another world -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value"),
    [
        long("coupling.impedance_nspm", 50.0),
        long("coupling.kind", "coupling"),
        long("link.loss", 0.35),
        long("object.mass_kg", 2.0),
        long("playout.frames", 4),
        ("users.1.stiffness_npm", 250.0),
        long("seed", 9),
    ],
)
def test_only_what_is_set_is_changed_and_it_is_run(run: RunRecords, tmp_path: Path, key: str, value: object) -> None:
    recorded = run.settings()
    other = what_if(run, {key: value})
    assert differences(recorded, other.settings) == {key: value}
    made = lab(other, tmp_path / "other")
    assert made.settings() == other.settings
    assert streams(made) != streams(run)
    kept = json.loads((made.folder / "settings.json").read_text())
    assert msgspec.convert(kept, Settings) == other.settings


def test_settings_that_were_changed_are_the_heading(run: RunRecords) -> None:
    changes = {"coupling.impedance_nspm": 50.0, "link.loss": 0.1, "object.mass_kg": 1.5}
    assert label(changes) == "coupling.impedance_nspm = 50.0, link.loss = 0.1, object.mass_kg = 1.5"
    assert label({}) == "unchanged"
    assert folder_name(run) == "pair-what-if"


@pytest.mark.parametrize(
    "changes", [{}, long({"object.mass_kg": 3.0}), {"link.loss": 0.5, "coupling.stiffness_npm": 200.0}]
)
def test_positions_are_the_recorded_ones_whatever_the_world(
    run: RunRecords, tmp_path: Path, changes: dict[str, Any]
) -> None:
    other = what_if(run, changes, "positions")
    recorded = run.settings()
    assert differences(recorded, other.settings) == {
        "users.0.device": f"replay:{run.folder}#user=anna", "users.1.device": f"replay:{run.folder}#user=ben", **changes,
    }  # fmt: skip
    made = lab(other, tmp_path / "other")
    for name, end in run.clients.items():
        before, after = (each.columns("tick", "position_m", "force_n") for each in (end, made.clients[name]))
        assert np.array_equal(before["position_m"], after["position_m"]), name
        assert np.array_equal(before["force_n"][:-1], after["force_n"][:-1]) == (not changes), name


@pytest.mark.long
@pytest.mark.parametrize("hands", ["same", long("impedance"), "positions"])
def test_a_live_session_can_be_asked_as_well(tmp_path: Path, hands: Hands) -> None:
    run = open_run(LIVE)
    other = what_if(run, {"link.delay_ms": 5.0}, hands)
    made = lab(other, tmp_path / "other")
    whole = round(other.settings.seconds * 128) * 8
    for number, (before, after) in enumerate(positions(run, made)):
        assert len(after) == whole - other.begins[number] >= len(before) - 8, "but for the end of the last frame"
        assert np.ptp(after) == pytest.approx(np.ptp(before), rel=0.2)


@pytest.mark.long
@pytest.mark.parametrize("late_ns", [long(0), 3_000_000, long(125_000_000), 203_125_000])
def test_people_begin_when_they_began(run: RunRecords, spoiled: Path, tmp_path: Path, late_ns: int) -> None:
    """People begin at the nearest frame and keep their seats until then; the result replays bit for bit."""
    rewrite(spoiled / "client-ben.mcap", late_ns=late_ns)
    other = what_if(open_run(spoiled), {}, "positions")
    assert other.begins == (0, round(late_ns * 128e-9) * 8)
    as_long = other.begins == (0, 0)  # less than half a frame late: nothing was longer than it should be
    assert other.settings.seconds == (0.625 if as_long else pytest.approx(0.625 + late_ns * 1e-9, abs=1e-6))
    made = lab(other, tmp_path / "other")
    before, after = (each.clients["ben"].columns("tick", "tick", "position_m") for each in (run, made))
    assert np.array_equal(after["tick"], np.arange(len(after["tick"])))
    shown = min(len(before["tick"]), len(after["tick"]))
    assert shown > 600
    assert np.array_equal(after["position_m"][:shown], before["position_m"][:shown])
    assert after["time_s"][0] == pytest.approx(other.begins[1] / 1024, abs=1e-6)
    for file in FILES:
        assert verify(open_recording(made.folder / file)).exact, file


def test_an_impedance_is_the_recorded_hands_own(run: RunRecords, tmp_path: Path) -> None:
    """Anna's hand named its stiffness and damping; Ben's had those of every hand. The machines stay the same."""
    other = what_if(run, {}, "impedance")
    anna, ben = other.settings.users
    assert (anna.device, ben.device) == ("sim:phantom", "sim:ideal")
    assert anna.hand == f"recording:{run.folder}#user=anna&hand_stiffness_npm=450&hand_damping_nspm=8"
    assert ben.hand == f"recording:{run.folder}#user=ben"
    hand = make_for(anna, 2).hand
    assert (hand.stiffness_npm, hand.damping_nspm) == (450.0, 8.0)
    made = lab(other, tmp_path / "other")
    assert all(np.abs(before - after).max() < 1e-3 for before, after in positions(run, made))


def test_it_lasts_as_long_as_the_longest_hand(spoiled: Path) -> None:
    def early(kind: str, message: RecordedMessage) -> bytes | None:
        return message.payload if message.time_ns < 400_000_000 else None

    rewrite(spoiled / "client-anna.mcap", early)
    assert what_if(open_run(spoiled), {}).settings.seconds == 0.625
    rewrite(spoiled / "client-ben.mcap", early)
    assert what_if(open_run(spoiled), {}).settings.seconds == pytest.approx(0.4, abs=2e-3)
    assert what_if(open_run(spoiled), {"seconds": 3.0}).settings.seconds == 3.0, "--set stands above"


def test_a_hand_that_never_ticked_cannot_be_run_again(spoiled: Path) -> None:
    rewrite(spoiled / "client-anna.mcap", lambda kind, message: message.payload if kind != "tick" else None)
    with pytest.raises(RecordingError, match="holds no ticks; there is no hand to run again"):
        what_if(open_run(spoiled), {})


# Who took part -------------------------------------------------------------------------------------------------------


def who(folder: Path, hands: Hands = "same") -> User:
    return what_if(open_run(folder), {}, hands).settings.users[0]


def test_a_simulated_hand_that_was_joined_with_is_taken_as_it_was(spoiled: Path) -> None:
    joined_with(spoiled / "client-anna.mcap", "sim:ideal?hand=hold")
    assert who(spoiled).device == "sim:ideal?hand=hold"
    made = make_for(who(spoiled), 2)
    assert (made.capability.model, type(made.hand).__name__) == ("ideal", "DirectedHand")


@pytest.mark.parametrize(
    "device", ["haply:/dev/ttyACM0", "replay:hand.csv#time=t&x=x", f"sim:ideal?hand=csv:{'a' * 200}"]
)
def test_other_hands_come_back_through_an_impedance(spoiled: Path, device: str) -> None:
    """A person's, one that was replayed, and one whose address did not fit into the hello."""
    joined_with(spoiled / "client-anna.mcap", device[:DEVICE_BYTES])
    anna = who(spoiled)
    assert (anna.device, anna.hand.partition("&")[0]) == ("sim:phantom", f"recording:{spoiled}#user=anna")
    assert who(spoiled, "positions").device == f"replay:{spoiled}#user=anna"


@pytest.mark.parametrize(
    ("model", "machine"), [("phantom", "sim:phantom"), ("ideal", "sim:ideal"), ("Inverse3", "sim:ideal")]
)
def test_a_machine_nobody_simulates_is_an_ideal_one(spoiled: Path, model: str, machine: str) -> None:
    with_start(spoiled / "client-anna.mcap", lambda hello, record: (hello, replace(record, model=model)))
    assert who(spoiled, "impedance").device == machine


@pytest.mark.parametrize("hands", ["same", "impedance"])
def test_the_machine_has_the_recorded_mass(spoiled: Path, hands: Hands) -> None:
    """`cogrip join --device sim:phantom?hand=hold` moves 75 g; a user of the settings moves device_mass_kg, 100 g."""

    joined_with(spoiled / "client-anna.mcap", "sim:phantom?hand=hold")
    with_start(spoiled / "client-anna.mcap", lambda hello, record: (hello, replace(record, apparent_mass_kg=0.075)))
    assert make_for(who(spoiled, hands), 2).capability.apparent_mass_kg == 0.075


# What cannot be asked ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("friction", 1, "friction: there is no such setting"),
        ("coupling.impedance_nspm", -1.0, "coupling.impedance_nspm: expects a number of at least 0.001"),
        ("users.2.stiffness_npm", 5.0, "there is no user number 2"),
        ("users.0.hand.speed", 5.0, "is a value, not a section"),
        ("link.loss", 1.0, "link.loss: expects a number of at most 0.99; got 1.0"),
        ("rates.network_hz", 100, "not a whole multiple"),
    ],
)
def test_a_setting_that_does_not_exist_or_fit_is_named(run: RunRecords, key: str, value: object, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        what_if(run, {key: value})


def test_a_part_that_is_missing_is_named(spoiled: Path) -> None:
    with pytest.raises(RecordingError, match=r"holds no recording of the server.*cogrip merge"):
        what_if(open_run(spoiled / "client-anna.mcap"), {})
    for person, there in (("anna", "ben"), ("ben", "nobody")):
        (spoiled / f"client-{person}.mcap").unlink()
        with pytest.raises(RecordingError, match=f"holds no recording of 'anna'; there is: {there}"):
            what_if(open_run(spoiled), {})


def test_the_recorded_settings_are_those_of_the_server(run: RunRecords) -> None:
    """settings.json is not read: anybody may have edited it."""
    (room,), _ = server_start(run.server.recording.header.start)
    assert run.settings() == room == resolve(TABLE)
