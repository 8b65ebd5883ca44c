"""Calibrations as files: kept, found again, told apart, and never half there."""

import json
import os
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cogrip.devices.arm.pose import Calibration, OwnLosses
from cogrip.devices.device import DeviceError
from cogrip.devices.io.calibration_store import FOLDER, CalibrationStore, calibration_folder

from tests.devices.held_device import refused

DEVICE = "serial:/dev/ttyACM0"


def made(device: str = DEVICE, **keys) -> Calibration:
    keys = {"model": "vintage", "offset_counts": (1.0, -7700.0, 0.5), "stamp": "boot:1:2", "made": "today", **keys}
    return Calibration(device=device, **keys)


def test_what_is_kept_is_found_by_another_program(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path / "a" / "b")
    assert store.find(DEVICE) is None
    path = store.keep(made(lost="encoder a jumped"))
    assert path.parent == tmp_path / "a" / "b"
    assert CalibrationStore(tmp_path / "a" / "b").find(DEVICE) == made(lost="encoder a jumped")
    assert [file.name for file in path.parent.iterdir()] == [path.name]
    assert path.name.startswith("serial-dev-ttyACM0-")
    assert json.loads(path.read_text())["offset_counts"] == [1.0, -7700.0, 0.5]


def test_a_file_from_before_losses_were_kept_is_read(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    path = store.keep(made())
    fields = json.loads(path.read_text())
    del fields["lost"]
    path.write_text(json.dumps(fields))
    assert store.find(DEVICE) == made()


def test_a_node_is_the_same_device_by_any_link_to_it(tmp_path: Path) -> None:
    """And where its link leads to a new node, it is another one: counters began anew."""
    nodes, link = [tmp_path / "ttyACM0", tmp_path / "ttyACM1"], tmp_path / "by-id"
    for node in nodes:
        node.touch()
    link.symlink_to(nodes[0])
    store = CalibrationStore(tmp_path / "store")
    store.keep(made(f"serial:{link}"))
    assert store.find(f"serial:{nodes[0]}") == store.find(f"serial:{link}") == made(f"serial:{link}")
    assert store.find(f"haply:{nodes[0]}") is None
    link.unlink()
    link.symlink_to(nodes[1])
    assert store.find(f"serial:{link}") is None


names = st.text(st.characters(exclude_characters="\0"), min_size=1, max_size=80)


@given(st.lists(names, min_size=2, max_size=2, unique=True))
@example(["0", "\udcff"])  # a byte of a command line that is no UTF-8
def test_different_devices_have_different_files(names: list[str]) -> None:
    store = CalibrationStore(Path("/nowhere"))
    first, second = (store.path_of(f"hid:{name}") for name in names)
    assert first != second
    assert first.parent == second.parent == Path("/nowhere")
    assert len(first.name) < 100
    assert first.name.isascii()


def file(counts: str = "[1,2,3]", stamp: str = '"stamp":"s",') -> str:
    return f'{{"device":"d","model":"m","offset_counts":{counts},{stamp}"made":"now"}}'


COUNTS = ("[1,2]", "[1,2,NaN]", "[1,2,1e999]", '[1,2,"3"]')
STAMPS = ('"stamp":7,', "")
FILES = ("", "{}", "nonsense", "[1,2,3]", *map(file, COUNTS), *(file(stamp=each) for each in STAMPS))


@pytest.mark.parametrize("text", FILES)
def test_a_file_that_is_none_of_ours_is_refused(tmp_path: Path, text: str) -> None:
    store = CalibrationStore(tmp_path)
    store.path_of(DEVICE).write_text(text)
    with refused("cannot be read as a calibration", "; delete it and calibrate serial:/dev/ttyACM0"):
        store.find(DEVICE)
    store.keep(made())
    assert store.find(DEVICE) == made()


def test_a_folder_that_cannot_be_written_is_named_with_its_cure(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = CalibrationStore(tmp_path / "file")
    with pytest.raises(DeviceError, match=rf"cannot be written: .*; name another folder in {FOLDER}"):
        store.keep(made())
    with pytest.raises(DeviceError, match="cannot be read as a calibration"):
        store.find(DEVICE)


def test_a_write_that_is_cut_off_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = CalibrationStore(tmp_path)
    store.keep(made(made="first"))

    def full(self: Path, target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(DeviceError, match="No space left on device"):
        store.keep(made(made="second"))
    assert store.find(DEVICE) == made(made="first")


def test_the_folder_is_the_users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv(FOLDER, raising=False)
    if os.name == "posix":
        assert calibration_folder() == tmp_path / "config" / "cogrip" / "calibration"
    monkeypatch.setenv(FOLDER, str(tmp_path / "mine"))
    assert calibration_folder() == tmp_path / "mine"
    assert CalibrationStore().keep(made()).parent == tmp_path / "mine"


def losses(**keys) -> OwnLosses:
    keys = {"drive": (1.0,) * 6, "own_damping_nspm": 0.3, "own_friction_n": 0.02, **keys}
    return OwnLosses(device=DEVICE, model="vintage", made="today", **keys)


def test_losses_are_kept_beside_the_calibration_and_outlive_it(tmp_path: Path) -> None:
    store = CalibrationStore(tmp_path)
    store.keep(made())
    assert store.find_losses(DEVICE) is None, "a folder from before they were identified"
    path = store.keep_losses(losses())
    assert json.loads(path.read_text())["version"] == 1
    store.keep(made(made="later"))
    assert CalibrationStore(tmp_path).find_losses(DEVICE) == losses()
    assert store.find(DEVICE) == made(made="later")
    assert store.find_losses("haply:/dev/ttyACM0") is None


@pytest.mark.parametrize(
    ("field", "value"),
    [("version", 2), ("own_damping_nspm", -0.1), ("own_friction_n", 1e9), ("own_friction_n", None), ("drive", "x")],
)
def test_losses_of_another_version_or_that_none_can_be_are_refused(tmp_path: Path, field: str, value: object) -> None:
    store = CalibrationStore(tmp_path)
    path = store.keep_losses(losses())
    path.write_text(json.dumps({**json.loads(path.read_text()), field: value}))
    with pytest.raises(DeviceError, match=r"-damping\.json: cannot be read as a calibration .*; delete it"):
        store.find_losses(DEVICE)
