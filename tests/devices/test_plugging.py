"""Stamps of devices: a new one when it was plugged in again, none where nothing is known."""

import os
import sys
from pathlib import Path

import pytest

from cogrip.devices.io.plugging import stamp_of


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="names of Linux's files")
def test_a_stamp_changes_when_the_node_is_made_anew_and_not_before(tmp_path: Path) -> None:
    node = tmp_path / "hidraw0"
    assert stamp_of(str(node)) == ""
    node.touch()
    first = stamp_of(str(node))
    assert first
    assert stamp_of(str(node)) == first
    node.unlink()
    (tmp_path / "takes its place").touch()
    node.touch()
    assert stamp_of(str(node)) not in ("", first)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="names of Linux's files")
def test_the_stamp_of_a_place_on_the_bus_is_that_of_the_device_there(tmp_path: Path) -> None:
    place = tmp_path / "1-2.3"
    place.mkdir()
    (tmp_path / "001").mkdir()

    def stamp(number: int) -> str:
        (place / "busnum").write_text("1\n")
        (place / "devnum").write_text(f"{number}\n")
        return stamp_of("1-2.3:1.0", tmp_path, tmp_path)

    for number in (7, 8):
        (tmp_path / "001" / f"00{number}").touch()
    first, second = stamp(7), stamp(8)
    assert "" != first != second != ""
    os.utime(tmp_path / "001" / "007", (0, 0))  # using such a node changes its times
    assert stamp(7) == first
    assert stamp(9) == ""


@pytest.mark.parametrize("path", ["", "1-2:1.0", "IOService:/AppleACPI", r"\\?\HID#VID_1234"])
def test_no_stamp_where_nothing_is_known(path: str, tmp_path: Path) -> None:
    assert stamp_of(path, tmp_path) == ""
    (tmp_path / "1-2").mkdir()
    (tmp_path / "1-2" / "busnum").write_text("250\n")
    (tmp_path / "1-2" / "devnum").write_text("99\n")  # no such node
    assert stamp_of(path, tmp_path) == ""
