"""`cogrip devices emulate hid` as a process of its own, on a real socket: the driver of `hid:` on it, and what may go wrong."""

import re
from collections.abc import Callable, Iterator
from math import hypot
from pathlib import Path
from struct import pack, unpack

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.hid.enumeration import VARIANTS
from cogrip.devices.io.hid_line import HidLine
from cogrip.devices.io.platform import SEQUENCED
from cogrip.devices.io.report_socket import is_socket
from cogrip.devices.registry import make

from tests import forked
from tests.devices.test_pseudo_terminal import LIMIT_S, Emulator, Loop, emulating
from tests.extent import long

pytestmark = pytest.mark.skipif(not SEQUENCED, reason="needs local sockets that keep messages apart")
NOTHING = bytes(15)
NO_FORCE = (0.0, 0.0, 0.0)


@pytest.fixture
def path(tmp_path: Path) -> str:
    return str(tmp_path / "arm")


@pytest.fixture
def emulate(path: str) -> Iterator[Callable[..., Emulator]]:
    yield from emulating(path, "hid")


def opened(path: str, variant: str = "mbed14") -> HidLine:
    port = HidLine("hid:test", VARIANTS[variant], path=path)
    port.open()
    return port


def answer(port: HidLine, report: bytes) -> tuple[int, ...]:
    port.write(report)
    return unpack("<7h", port.read(LIMIT_S))


def test_reports_are_the_firmware_s_one_for_each(emulate: Callable[..., Emulator], path: str) -> None:
    emulator = emulate("--hand", "hold")
    assert is_socket(path)
    port = opened(path)
    assert port.counts == {"old report thrown away": 1}  # it was filled at power-up
    first = answer(port, NOTHING)
    assert port.read(0.05) == b""
    emulator.ask("press", "the calibrate button was pressed: the host is told")
    assert answer(port, NOTHING) == (*first[:6], 1)
    assert answer(port, pack("<B7h", 0, 0, 30, 7, 1, 1, 2, 3)) == (1, 2, 3, 0, 30, 7, 0)
    port.close()
    emulator.tell("quit")
    assert emulator.end() == 0
    assert not is_socket(path)


@pytest.mark.parametrize("model", ["polhem", long("woodenhaptics")])
def test_a_driver_on_it_sees_where_it_is_and_loads_the_hand(
    emulate: Callable[..., Emulator], path: str, model: str
) -> None:
    """The motors of the Polhem hold its weight beside the force; so its tip is where the force alone puts it."""
    emulator = emulate("--model", model, "--hand", "hold")
    device = make(f"hid:{model}?path={path}&pose=home&backend=libusb", axes=3)
    device.open(1000)
    loop = Loop(device)
    sample = loop.run((0.3, -0.2, 0.1), 1000)
    status = emulator.status()
    assert [1e3 * part for part in sample.position_m] == pytest.approx(status["at_mm"], abs=0.2)
    assert status["at_mm"] == pytest.approx([-1.0, 0.667, -0.333], abs=0.2)  # 300 N/m hold it
    held = hypot(0.608, 0.975) if model == "polhem" else 0.0
    assert status["peak_n"][0] > max(0.3, held)
    device.close()
    assert emulator.status()["force_n"] == [0.0, 0.0, 0.0]


def test_it_may_be_unplugged_and_plugged_in_again(emulate: Callable[..., Emulator], path: str) -> None:
    emulator = emulate("--hand", "hold")
    port = opened(path)
    stamp = port.stamp()
    assert stamp
    emulator.ask("unplug", "unplugged")
    with pytest.raises(DeviceError, match=r"unplugged.*plug it in again, then re-arm"):
        port.read(LIMIT_S)
    port.close()
    emulator.ask("mend", "plugged in again")
    port.open()
    assert port.stamp() != stamp
    assert len(answer(port, NOTHING)) == 7
    port.close()


def test_one_program_at_a_time_and_another_after_it(emulate: Callable[..., Emulator], path: str) -> None:
    emulate("--hand", "hold")
    first = opened(path)
    before = answer(first, NOTHING)
    with pytest.raises(DeviceError, match="hung up"):
        opened(path)
    assert answer(first, NOTHING) == before
    first.close()
    second = opened(path)
    assert answer(second, NOTHING) == before
    second.close()


def test_another_variant_is_refused_and_so_is_a_socket_that_nobody_serves(
    emulate: Callable[..., Emulator], path: str
) -> None:
    emulator = emulate("--hand", "hold")
    with pytest.raises(DeviceError, match=r"its reports have 14 bytes, not 64; set the key variant"):
        opened(path, "teensy64")
    emulator.popen.kill()
    emulator.popen.wait()
    assert is_socket(path)
    with pytest.raises(DeviceError, match=r"refused.*cogrip devices emulate hid --link"):
        opened(path)
    emulate("--hand", "hold")  # takes its place
    opened(path).close()


def test_it_conforms_over_the_socket_as_a_process(emulate: Callable[..., Emulator], path: str) -> None:
    emulate("--model", "polhem", "--hand", "hold")
    address = f"hid:polhem?path={path}&pose=home"
    with forked.start("devices", "conform", address, "--yes") as done:
        said, _ = done.communicate(timeout=LIMIT_S)
    if re.search(r"encoder \w jumped by", said):
        pytest.skip(f"this machine took the processor away for too long: {said}")
    broken = re.findall(r"✗ +(\w+)", said)
    # the speed of this machine decides these: an arm that is a process is late where it has no processor
    assert set(broken) <= {"calls_do_not_block", "moves_as_its_record_says"}, said
    assert done.returncode == (1 if broken else 0), said


@pytest.fixture
def emulate_unlinked() -> Iterator[Callable[..., Emulator]]:
    yield from emulating("", "hid")


def test_without_a_link_it_makes_a_place_of_its_own_and_takes_it_away(
    emulate_unlinked: Callable[..., Emulator],
) -> None:
    emulator = emulate_unlinked("--hand", "hold")
    place = emulator.place.partition("path=")[2]
    assert is_socket(place)
    emulator.tell("quit")
    assert emulator.end() == 0
    assert not Path(place).parent.exists()
