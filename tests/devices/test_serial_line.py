"""The serial port on real pseudo-terminals: whatever a cable can do, as an error with its cure; no wait is without end."""

import os
import re
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
import serial

from cogrip.devices.device import DeviceError
from cogrip.devices.io.platform import awaited
from cogrip.devices.io.serial_line import SerialLine
from cogrip.devices.serial.frames import BracketCodec

from tests.devices.held_device import refused

ZERO = BracketCodec().encode((0, 0, 0))
LONG_S = 60.0  # a wait that ends when what it waits for is there

if os.name != "posix":
    pytest.skip("pseudo-terminals are POSIX", allow_module_level=True)


class Line:
    """A pseudo-terminal; the device's end is `master`."""

    def __init__(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self.slave)

    def send(self, data: bytes) -> None:
        assert os.write(self.master, data) == len(data)

    def heard(self, size: int = 1) -> bytes:
        """Read at least so many bytes: a terminal may hand on in parts what was written at once."""
        data = b""
        while len(data) < size:
            assert select.select([self.master], [], [], LONG_S)[0], data
            data += os.read(self.master, 65536)
        return data

    def unplug(self) -> None:
        for descriptor in (self.master, self.slave):
            if descriptor >= 0:
                os.close(descriptor)
        self.master = self.slave = -1


@pytest.fixture
def line() -> Iterator[Line]:
    made = Line()
    yield made
    made.unplug()


@pytest.fixture
def port(line: Line) -> Iterator[SerialLine]:
    made = SerialLine(line.path, "serial")
    made.open()
    yield made
    made.close()


def come(port: SerialLine, size: int) -> bytes:
    """Read at least so many bytes, waiting for each part."""
    data = b""
    while len(data) < size:
        part = port.read(LONG_S)
        assert part, data
        data += part
    return data


def test_making_it_opens_nothing() -> None:
    port = SerialLine("/dev/nosuch", "serial")
    assert port.name == "serial:/dev/nosuch"
    port.close()
    for verb in (port.read, lambda: port.write(ZERO)):
        with pytest.raises(DeviceError, match="serial:/dev/nosuch: is closed; open it first"):
            verb()


def test_bytes_go_both_ways_as_they_are_and_what_has_come_is_read_at_once(line: Line, port: SerialLine) -> None:
    every = bytes(range(256))
    port.write(every)
    assert line.heard(len(every)) == every
    assert port.read() == b""
    for data in (every, b"[2,1,2", b",3,0,0,0,0]\n[2,"):
        line.send(data)
        assert come(port, len(data)) == data
        assert port.read() == b""
    for wait_s in (0.0, 1e-6, 0.00025, 0.02):  # each wait for nothing ends
        assert port.read(wait_s) == b""


def test_what_was_on_the_line_before_is_not_read(line: Line) -> None:
    line.send(b"old")
    assert select.select([line.slave], [], [], LONG_S)[0]
    with closing(SerialLine(line.path, "serial")) as port:
        port.open()
        assert port.read() == b""


def test_it_is_exclusive(line: Line, port: SerialLine) -> None:
    other = SerialLine(line.path, "haply")
    with refused(f"haply:{line.path}: cannot be opened: ", "lock", "; close the program that uses it"):
        other.open()
    with pytest.raises(DeviceError, match="is open already; close it first"):
        port.open()
    port.write(ZERO)
    port.close()
    port.close()
    other.open()
    other.close()


def test_a_port_that_is_not_there() -> None:
    cure = "; plug the device in, and look for its name with `cogrip devices find`"
    with pytest.raises(DeviceError, match=rf"^serial:/dev/ttyNOSUCH7: cannot be opened: .*{cure}$"):
        SerialLine("/dev/ttyNOSUCH7", "serial").open()


@pytest.mark.parametrize("kind", ["file", "folder", "fifo"])
def test_what_is_no_serial_port(tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    {"file": path.touch, "folder": path.mkdir, "fifo": lambda: os.mkfifo(path)}[kind]()
    port = SerialLine(str(path), "serial")
    with pytest.raises(DeviceError, match=r"cannot be opened: .*; check its cable and power"):
        port.open()
    with pytest.raises(DeviceError, match="is closed"):
        port.read()


@pytest.mark.parametrize(
    ("number", "cure"),
    [
        (13, "give yourself the right to it (configs/99-cogrip.rules, or the group dialout)"),
        (16, "close the program that uses it"),
        (11, "close the program that uses it"),
        (5, "check its cable and power"),
    ],
)
def test_every_reason_has_its_cure(line: Line, monkeypatch: pytest.MonkeyPatch, number: int, cure: str) -> None:
    def refuse(*arguments: object, **keys: object) -> None:
        assert keys["exclusive"] is True
        raise serial.SerialException(number, f"[Errno {number}] {os.strerror(number)}")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(DeviceError, match=rf"{os.strerror(number)}.*; {re.escape(cure)}$"):
        SerialLine(line.path, "serial").open()


@pytest.mark.parametrize("verb", ["read", "wait", "write"])
def test_an_unplugged_device_is_lost_until_it_is_there_again(line: Line, port: SerialLine, verb: str) -> None:
    port.write(ZERO)
    line.unplug()
    do = {"read": port.read, "wait": lambda: port.read(LONG_S), "write": lambda: port.write(ZERO)}[verb]
    for _ in range(3):
        with pytest.raises(DeviceError, match=rf"serial:{line.path}: lost: .*; plug it in again, then re-arm"):
            do()
    port.close()
    with pytest.raises(DeviceError, match="cannot be opened"):
        port.open()


def test_a_device_that_is_unplugged_while_it_is_waited_for(line: Line, port: SerialLine) -> None:
    device = threading.Thread(target=lambda: line.heard() and line.unplug())
    device.start()
    port.write(ZERO)
    with pytest.raises(DeviceError, match="lost: "):
        port.read(LONG_S)
    device.join()


def test_an_end_that_has_gone_is_no_silence_but_what_somebody_else_has_read_is() -> None:
    """Readable, yet nothing to read, and hung up: a closing terminal is so for a moment, a pipe without a writer for ever.

    A guard reads the line as well: readable, then nothing there, as /dev/null always is.
    """
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    assert awaited(reader, 0.0) == b""
    os.write(writer, b"[2]")
    assert awaited(reader, LONG_S) == b"[2]"
    os.close(writer)
    with pytest.raises(OSError, match="hung up"):
        awaited(reader, LONG_S)
    os.close(reader)
    with open(os.devnull, "rb") as nothing:
        assert awaited(nothing.fileno(), LONG_S) == b""


def test_a_device_that_does_not_read_is_found_out_and_does_not_hold_us_up(line: Line, port: SerialLine) -> None:
    """The line takes some kilobytes, then a part of a frame, then nothing."""
    said = []
    for _ in range(10_000):
        try:
            port.write(bytes(1000))
        except DeviceError as error:
            said.append(str(error))
            if "took 0 of" in said[-1]:
                break
    assert all(text.endswith("of 1000 bytes: the device does not read; check it, then re-arm") for text in said)
    assert "took 0 of 1000 bytes" in said[-1]
    heard = b""
    while not heard.endswith(ZERO):  # it reads again; what it has not read yet may still fill the line
        heard = heard[-len(ZERO) :] + line.heard()
        with suppress(DeviceError):
            port.write(ZERO)


def test_its_stamp_names_this_terminal(line: Line, port: SerialLine, tmp_path: Path) -> None:
    stamp = port.stamp()
    assert stamp
    link = tmp_path / "arm"
    link.symlink_to(line.path)
    assert SerialLine(str(link), "serial").stamp() == stamp
    other = Line()
    assert SerialLine(other.path, "serial").stamp() != stamp
    other.unplug()
    port.close()
    line.unplug()
    assert port.stamp() != stamp
