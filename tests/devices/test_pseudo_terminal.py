"""`cogrip devices emulate serial` as a process of its own, on a real pseudo-terminal: its verbs, and a driver on it.

Nothing sleeps: what is waited for is a line that is said, or a byte that comes, with an end to every wait.
"""

import os
import re
import select
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import pytest

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.device import DeviceError, Sample
from cogrip.devices.io.serial_line import SerialLine
from cogrip.devices.registry import make
from cogrip.devices.serial.frames import BracketCodec
from cogrip.machine.pacing import Pacer

from tests import forked
from tests.fair_time import FairTime

if os.name != "posix":
    pytest.skip("pseudo-terminals are POSIX", allow_module_level=True)

LIMIT_S = 60.0  # for anything that is waited for; a hang then fails with what was said
RATE_HZ = 1024
ZERO = BracketCodec().encode((0, 0, 0))
HOME = b"[2,0,-534,-36,0,0,0,0]\n"


class Emulator:
    """The process. `ask` writes a verb and waits for the line that answers it."""

    def __init__(self, *arguments: str, kind: str = "serial") -> None:
        self.popen = forked.start(
            "devices", "emulate", kind, "--no-fast", *arguments, stdin=subprocess.PIPE,
            env={**os.environ, "COLUMNS": "200", "NO_COLOR": "1"},
        )  # fmt: skip
        forked.never_late(self.popen)
        self.said = b""
        self.place = ""
        self._read_to = 0

    def hear(self, pattern: str) -> re.Match[str]:
        """The next line that matches, of those not heard yet."""
        assert self.popen.stdout is not None
        while True:
            for line in self.said[self._read_to :].splitlines(keepends=True):
                if not line.endswith(b"\n"):
                    break
                self._read_to += len(line)
                if found := re.search(pattern, line.decode()):
                    return found
            assert select.select([self.popen.stdout], [], [], LIMIT_S)[0], f"never said {pattern!r}, but: {self.said!r}"
            data = os.read(self.popen.stdout.fileno(), 65536)
            assert data, f"ended before it said {pattern!r}: {self.said!r}"
            self.said += data

    def tell(self, verb: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(f"{verb}\n")
        self.popen.stdin.flush()

    def ask(self, verb: str, pattern: str) -> re.Match[str]:
        self.tell(verb)
        return self.hear(pattern)

    def status(self) -> dict[str, list[float]]:
        found = self.ask("status", r"at \((.*)\) mm, counters \((.*)\), pushes with \((.*)\) N, most so far (.*) N")
        numbers = ([float(part) for part in text.split(",")] for text in found.groups())
        return dict(zip(("at_mm", "counters", "force_n", "peak_n"), numbers, strict=True))

    def end(self) -> int:
        return self.popen.wait(LIMIT_S)


def emulating(path: str, kind: str) -> Iterator[Callable[..., Emulator]]:
    """Yield a function that starts one and gives it when it can be opened; at the end whatever still runs is ended.

    path: of its link, or "" for none. The emulator's `place` is where it says that it is.
    """
    started: list[Emulator] = []

    def start(*arguments: str) -> Emulator:
        emulator = Emulator(*(("--link", path) if path else ()), *arguments, kind=kind)
        started.append(emulator)
        emulator.place = emulator.hear(rf"behind {kind}:([^;]+)")[1]
        return emulator

    yield start
    for emulator in started:
        if emulator.popen.poll() is None:
            emulator.popen.kill()
        emulator.popen.wait()
        for pipe in (emulator.popen.stdin, emulator.popen.stdout):
            assert pipe is not None
            pipe.close()


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "arm")


@pytest.fixture
def emulate(path: str) -> Iterator[Callable[..., Emulator]]:
    yield from emulating(path, "serial")


@pytest.fixture
def wired(emulate: Callable[..., Emulator], path: str) -> Iterator[tuple[Emulator, SerialLine]]:
    """An emulator whose hand holds, and an open port to it."""
    emulator, port = emulate("--hand", "hold"), SerialLine(path, "serial")
    port.open()
    yield emulator, port
    port.close()


def line(port: SerialLine) -> bytes:
    """Return the bytes up to the end of a line."""
    data = b""
    for _ in range(1000):
        data += port.read(LIMIT_S)
        if data.endswith(b"\n") or not data:
            return data
    return data


class Loop:
    """A live loop on a driver: its ticks are the clock's, so that it knows of those it missed."""

    def __init__(self, device: ArmDevice) -> None:
        self._device = device
        self._pacer = Pacer(RATE_HZ, time.monotonic_ns())

    def turn(self, force_n: tuple[float, ...]) -> Sample | None:
        sample = self._device.read(self._pacer.wait())
        self._device.write(force_n)
        return sample

    def run(self, force_n: tuple[float, ...], answers: int) -> Sample:
        """Until so many samples have come; the last one."""
        waited = FairTime()
        while True:
            assert waited.spent_s() < LIMIT_S, self._device.counts
            sample = self.turn(force_n)
            answers -= sample is not None
            if sample is not None and answers <= 0:
                return sample


# by hand


def test_it_answers_as_the_device_does_and_says_how_it_stands(wired: tuple[Emulator, SerialLine], path: str) -> None:
    emulator, port = wired
    assert Path(path).is_symlink()
    port.write(ZERO)
    assert line(port) == HOME
    assert emulator.status() == {
        "at_mm": [0.0] * 3, "counters": [0.0, -534.0, -36.0], "force_n": [0.0] * 3, "peak_n": [0.0]
    }  # fmt: skip
    port.write(b"[1,2,3]\n[4,5,6]\n")  # in one write
    replies = b""
    while replies.count(b"\n") < 2:
        replies += line(port)
    assert [int(reply.split(b",")[7][:-1]) for reply in replies.splitlines()] == [8, 256]
    emulator.ask("press", "the calibrate button was pressed: the counters are zero")
    port.write(ZERO)
    assert line(port) == b"[2,0,0,0,0,0,0,0]\n"
    port.close()
    emulator.tell("quit")
    assert emulator.end() == 0
    assert not Path(path).is_symlink()


@pytest.mark.parametrize(("model", "number"), [("polhem", b"1"), ("woodenhaptics-serial", b"3")])
def test_it_is_any_of_the_machines(emulate: Callable[..., Emulator], path: str, model: str, number: bytes) -> None:
    emulate("--model", model, "--hand", "hold", "--powered-at-m", "0.0", "0.0", "0.0")
    with closing(SerialLine(path, "serial")) as port:
        port.open()
        port.write(ZERO)
        assert line(port) == b"[%s,0,0,0,0,0,0,0]\n" % number


NO_VERBS = (
    "fire", "silence now", "silence 0", "silence -1", "silence nan", "silence 1 2", "SILENCE", "mend 1", "status all",
    "\x00\x01", "\xff", "[bold]silence[/bold]", "quit now", "press 0.1",
)  # fmt: skip


def test_what_is_no_verb_is_said_and_does_nothing(emulate: Callable[..., Emulator]) -> None:
    emulator = emulate("--hand", "hold")
    for verb in NO_VERBS:
        said = emulator.ask(verb, r"write a fault and its seconds").string
        assert all(name in said for name in ("silence", "deaf", "mend", "press", "status", "quit")), verb
    emulator.tell("")
    emulator.tell("   ")
    assert emulator.status()["peak_n"] == [0.0]
    assert b"fault " not in re.sub(rb"write a fault", b"", emulator.said)


def test_a_fault_is_said_and_lasts_as_long_as_it_should(wired: tuple[Emulator, SerialLine]) -> None:
    emulator, port = wired
    emulator.ask("silence", "fault silence")
    port.write(ZERO)
    assert emulator.status()["peak_n"] == [0.0]  # it heard the frame by then, or the terminal has not handed it on yet
    assert port.read() == b""
    emulator.ask("mend", "mended")
    port.write(ZERO)
    assert set(line(port).splitlines(keepends=True)) == {HOME}
    emulator.ask("silence 0.001", "fault silence 0.001")
    for _ in range(100_000):  # until it is over
        port.write(ZERO)
        if port.read(0.05):
            break
    else:
        pytest.fail("it never spoke again")


def test_unplugged_it_is_gone_and_mended_it_is_a_new_one(wired: tuple[Emulator, SerialLine], path: str) -> None:
    emulator, port = wired
    stamp = port.stamp()
    emulator.ask("unplug", "^unplugged")
    assert not Path(path).is_symlink()
    with pytest.raises(DeviceError, match="lost: "):
        port.read(LIMIT_S)
    port.close()
    with pytest.raises(DeviceError, match="cannot be opened"):
        port.open()
    emulator.ask("mend", rf"plugged in again: {path}")
    port.open()
    assert port.stamp() != stamp
    port.write(ZERO)
    assert line(port) == b"[2,0,0,0,0,0,0,0]\n"


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGINT, "quit", "end of input"])
def test_however_it_ends_it_takes_its_link_along(emulate: Callable[..., Emulator], path: str, end: object) -> None:
    emulator = emulate()
    if end == "quit":
        emulator.tell("quit")
    elif end == "end of input":
        assert emulator.popen.stdin is not None
        emulator.popen.stdin.close()
    else:
        emulator.popen.send_signal(end)
    assert emulator.end() == 0
    assert not os.path.lexists(path)
    assert b"Traceback" not in emulator.said


def test_its_watchdog_lets_go_when_the_driver_is_killed(wired: tuple[Emulator, SerialLine]) -> None:
    emulator, port = wired
    port.write(b"[300,0,0]\n\0\0\0\0\0\0")
    assert line(port)
    port.close()  # without a goodbye
    for _ in range(10_000):
        status = emulator.status()
        if not any(status["force_n"]):
            break
    assert status["force_n"] == [0.0] * 3
    assert status["peak_n"][0] > 0.1


def test_a_driver_that_does_not_read_does_not_stop_it(wired: tuple[Emulator, SerialLine]) -> None:
    emulator, port = wired
    for _ in range(200):
        for _ in range(10):
            port.write(ZERO)
        emulator.status()
    port.close()
    emulator.tell("quit")
    assert emulator.end() == 0


# the driver on it


def device_at(path: str, keys: str = "pose=home") -> ArmDevice:
    device = make(f"serial:{path}?{keys}", axes=3)
    assert isinstance(device, ArmDevice)
    return device


def test_a_driver_on_it_sees_where_it_is_and_loads_the_hand(emulate: Callable[..., Emulator], path: str) -> None:
    emulator = emulate("--hand", "hold")
    device = device_at(path)
    assert device.capability.model == "vintage"
    device.open(RATE_HZ)
    loop = Loop(device)
    for _ in range(100):  # again where the machine was busy: its watchdog let go, or the driver missed a movement
        try:
            loop.run((0.6, -0.2, 0.3), 300)
            status = emulator.status()
            sample = loop.run((0.6, -0.2, 0.3), 2)
        except DeviceError as error:
            if "jumped" not in str(error):
                raise
            device.close()
            device = device_at(path)
            device.open(RATE_HZ)
            loop = Loop(device)
            continue
        if any(status["force_n"]) and any(emulator.status()["force_n"]):
            break
    assert status["force_n"] == pytest.approx([-0.6, 0.2, -0.3], abs=0.02)
    assert sample.position_m == pytest.approx([1e-3 * at for at in status["at_mm"]], abs=5e-4)
    assert sample.position_m[0] < -2e-4
    device.close()
    assert emulator.status()["force_n"] == [0.0] * 3


def test_a_driver_that_is_unplugged_calibrates_and_goes_on(
    emulate: Callable[..., Emulator], path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The link leads to another terminal afterwards; the calibration of the first one does not hold for it."""
    monkeypatch.setenv("COGRIP_CALIBRATION", str(tmp_path / "kept"))
    emulator = emulate("--hand", "hold", "--powered-at-m", "0.0", "0.0", "0.0")
    device = device_at(path, "pose=stored")
    with pytest.raises(DeviceError, match=f"run `cogrip devices calibrate serial:{path}`"):
        device.open(RATE_HZ)
    keep(path)
    device.open(RATE_HZ)
    loop = Loop(device)
    loop.run((0.0, 0.0, 0.0), 50)
    emulator.ask("unplug", "^unplugged")
    with pytest.raises(DeviceError, match="lost: "):
        loop.run((0.0, 0.0, 0.0), 10**6)
    emulator.ask("mend", "plugged in again")
    device.close()
    with pytest.raises(DeviceError, match="its pose is not known"):
        device.open(RATE_HZ)
    keep(path)
    device.open(RATE_HZ)
    Loop(device).run((0.0, 0.0, 0.0), 50)
    device.close()


def keep(path: str) -> None:
    """Another program calibrates it; that it is not in its home pose is no matter here, as long as the tip stays inside."""
    from cogrip.devices.io.calibration_store import CalibrationStore

    calibration = device_at(path).calibrate("now")
    CalibrationStore().keep(calibration)


def test_every_fault_of_the_wire_leaves_a_driver_that_goes_on_when_it_is_over(
    emulate: Callable[..., Emulator], path: str
) -> None:
    emulator = emulate("--hand", "hold")
    device = device_at(path)
    device.open(RATE_HZ)
    loop = Loop(device)
    loop.run((0.2, 0.0, 0.0), 50)
    for verb in ("garbage", "short", "split", "merge", "silence", "slow", "deaf", "stale"):
        emulator.ask(verb, f"fault {verb}")
        for _ in range(30):
            loop.turn((0.2, 0.0, 0.0))
        emulator.ask("mend", "mended")
        while loop.run((0.2, 0.0, 0.0), 1).age_ticks > 1:
            pass
    assert emulator.status()["peak_n"][0] < 0.25
    assert {"bytes skipped", "reply in parts", "reply late", "reply missed"} <= set(device.counts)
    device.close()
    assert emulator.status()["force_n"] == [0.0] * 3
