"""The real package hidapi, with both its backends, on a stub of the C library beneath it.

This file is also the program that runs below `LD_PRELOAD`: each scenario is a function that asserts, the tests ask what came
of it.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.arm.models import MODELS
from cogrip.devices.device import DeviceError
from cogrip.devices.emulated.device import Notebook
from cogrip.devices.hid.family import drive
from cogrip.devices.hid.frames import CODECS
from cogrip.devices.hid.variants import VARIANTS
from cogrip.devices.io.hid_port import HidPort, load_hidapi
from cogrip.devices.io.plugging import stamp_of
from cogrip.devices.settings import parse_address

STUB = Path(__file__).parent / "stubs" / "hidapi_stub.c"
BACKENDS = {"hidraw": "hidraw", "hid": "libusb"}
NAME = "hid:woodenhaptics"
NOTHING = bytes(15)
LONG_S = 20.0  # a wait that ends when what it waits for is there
WAITED = (
    "report waits for the one before"  # the stub's reply may be here before the thread that wrote knows that it did
)
MODEL = MODELS["woodenhaptics"]

Scenario = Callable[["Bench"], None]
SCENARIOS: dict[str, Scenario] = {}


def scenario(function: Scenario) -> Scenario:
    SCENARIOS[function.__name__] = function
    return function


class Bench:
    """The stub's knobs, and what is driven."""

    def __init__(self, stub: ctypes.CDLL, backend: str, folder: Path) -> None:
        self._stub = stub
        self.backend = backend
        self.folder = folder
        stub.stub_opened.restype = ctypes.c_char_p
        stub.stub_reset()

    def set(self, **values: int) -> None:
        for name, value in values.items():
            self._stub.stub_set(name.encode(), value)

    def __getitem__(self, name: str) -> int:
        return self._stub.stub_get(name.encode())

    def say(self, **texts: str) -> None:
        for name, text in texts.items():
            self._stub.stub_text(name.encode(), text.encode())

    @property
    def opened(self) -> str:
        return self._stub.stub_opened().decode()

    @property
    def currents(self) -> tuple[int, int, int]:
        return self["current_a"], self["current_b"], self["current_c"]

    def port(self, variant: str = "mbed14", **asked: str) -> HidPort:
        return HidPort(NAME, VARIANTS[variant], self.backend, **asked)

    def open(self, variant: str = "mbed14", **asked: str) -> HidPort:
        port = self.port(variant, **asked)
        port.open()
        return port

    def device(self, keys: str = "pose=home", notebook: Notebook | None = None) -> ArmDevice:
        address = parse_address(f"{NAME}?backend={self.backend}&{keys}")
        return drive(self.port(), NAME, notebook or Notebook(), address, 3)

    def stand_at(self, counts) -> None:
        self.set(**dict(zip("abc", map(round, counts), strict=True)))


def fails(verb: Callable[[], object], *says: str) -> None:
    with pytest.raises(DeviceError) as caught:
        verb()
    assert [part for part in says if part not in str(caught.value)] == [], caught.value


def fails_at_last(port: HidPort, *says: str) -> None:
    """What goes wrong in the thread that writes is told by a later verb."""

    def read_on() -> None:
        for _ in range(100):
            port.read(0.05)

    fails(read_on, *says)


# the port


@scenario
def a_request_has_one_reply(bench: Bench) -> None:
    port, codec = bench.open(), CODECS["mbed14"]()
    bench.set(a=400, b=-300, c=6200, d=10030, e=12, f=-5, info=1)
    assert port.read() == b""
    for number in (1, 2, 3):
        port.write(codec.encode((number, -number, 0)))
        report = port.read(LONG_S)
        assert report == bytes.fromhex("9001d4fe38182e270c00fbff0100")
        [reading] = codec.feed(report)
        assert reading.raw == (400, -300, 6200)
        assert reading.buttons == 1
        assert bench.currents == (number, -number, 0)
        assert bench["length_written"] == 15
        assert port.read() == b""
    port.close()
    port.close()
    assert (bench["is_open"], bench["closed"]) == (0, 1)
    assert port.counts.keys() <= {WAITED}


@scenario
def a_closed_port_says_so(bench: Bench) -> None:
    port = bench.port()
    fails(port.read, "is closed; open it first")
    fails(lambda: port.write(NOTHING), "is closed")
    port.open()
    fails(port.open, "is open already")
    port.close()
    fails(port.read, "is closed")
    port.open()
    port.write(NOTHING)
    assert len(port.read(LONG_S)) == 14
    port.close()


@scenario
def waits_are_whole_milliseconds_and_never_for_ever(bench: Bench) -> None:
    port = bench.open()
    for wait_s, wait_ms in ((0.0, -2), (-1.0, -2), (1e-9, -2), (0.00024, -2), (0.000999, -2), (0.001, 1), (0.0029, 2)):
        bench.set(last_wait_ms=-2)
        assert port.read(wait_s) == b""
        assert bench["last_wait_ms"] == wait_ms, wait_s
    port.close()


@scenario
def a_short_wait_sees_what_comes_meanwhile(bench: Bench) -> None:
    port = bench.open()
    for _ in range(20):
        port.write(NOTHING)
        while not port.read(0.0009):
            pass
    assert port.counts.keys() <= {WAITED}
    port.close()


@scenario
def of_several_reports_the_newest_is_read(bench: Bench) -> None:
    port = bench.open()
    bench.set(extra=4, a=100)
    port.write(NOTHING)
    while bench["left_in_queue"] < 5:
        pass
    report = port.read()
    assert int.from_bytes(report[:2], "little") == 104
    assert port.counts == {"older report passed over": 4}
    assert port.read() == b""
    port.close()


@scenario
def the_report_that_waited_is_thrown_away(bench: Bench) -> None:
    bench.set(stale=1, a=5)
    port = bench.open()
    assert port.counts == {"old report thrown away": 1}
    assert port.read() == b""
    port.write(NOTHING)
    assert int.from_bytes(port.read(LONG_S)[:2], "little") == 5
    port.close()


@scenario
def reports_of_another_length_are_another_firmware(bench: Bench) -> None:
    bench.set(stale=1, stale_bytes=8)
    port = bench.port()
    fails(port.open, "its reports have 8 bytes, not 14; set the key variant")
    assert bench["is_open"] == 0
    old = bench.open("mbed8")
    old.close()


@scenario
def a_longer_report_is_not_cut_to_a_right_one(bench: Bench) -> None:
    port, codec = bench.open(), CODECS["mbed14"]()
    bench.set(report_bytes=20)
    port.write(bytes(21))
    assert codec.feed(port.read(LONG_S)) == []
    assert codec.skipped == 1
    port.close()


# which device


@scenario
def none_is_there(bench: Bench) -> None:
    bench.set(devices=0)
    fails(bench.open, "no device 1234:0006 is there; plug it in", "99-cogrip.rules")


@scenario
def another_product(bench: Bench) -> None:
    bench.say(product="Balance Toy")
    fails(bench.open, "'Balance Toy', not 'HID DEVICE'")


@scenario
def two_are_told_apart(bench: Bench) -> None:
    bench.set(devices=2)
    fails(bench.open, "2 devices 1234:0006", "/dev/hidraw7 serial=0123456789", "serial=second", "choose by serial=")
    for asked, path in (({"serial": "second"}, "/dev/hidraw7-second"), ({"path": "/dev/hidraw7"}, "/dev/hidraw7")):
        port = bench.open(**asked)
        assert bench.opened == port.path == path
        port.close()
    fails(lambda: bench.open(serial="third"), "has serial=third")
    fails(lambda: bench.open(path="/dev/hidraw8"), "has path=/dev/hidraw8")


@scenario
def a_link_is_followed(bench: Bench) -> None:
    node, link = bench.folder / "hidraw3", bench.folder / "arm"
    node.touch()
    link.symlink_to(node)
    bench.say(path=str(node))
    bench.set(devices=2)
    port = bench.open(path=str(link))
    assert bench.opened == str(node)
    port.close()


@scenario
def the_one_interface_of_a_teensy(bench: Bench) -> None:
    for tells_usage in (1, 0):
        bench.set(vendor=0x16C0, product=0x0486, interfaces=2, report_bytes=64, tells_usage=tells_usage, b=-7)
        bench.say(product="Teensyduino RawHID")
        port, codec = bench.open("teensy64"), CODECS["teensy64"]()
        assert bench.opened == "/dev/hidraw7"
        port.write(codec.encode((1, 2, 3)))
        [reading] = codec.feed(port.read(LONG_S))
        assert reading.raw == (0, -7, 0)
        assert bench["length_written"] == 65
        assert bench.currents == (1, 2, 3)
        port.close()


@scenario
def it_cannot_be_opened(bench: Bench) -> None:
    bench.set(open_fails=1)
    fails(bench.open, "/dev/hidraw7 cannot be opened", "close the program that uses it", "99-cogrip.rules")


# what goes wrong


@scenario
def a_write_that_fails_or_is_short(bench: Bench) -> None:
    for result in (-1, 7, 14, 16):
        port = bench.open()
        bench.set(write_result=result)
        port.write(NOTHING)
        fails_at_last(port, f"a report of 15 bytes was written, the answer is {result}", "re-arm")
        fails(lambda port=port: port.write(NOTHING), f"the answer is {result}")
        port.close()
        bench.set(write_result=0)
    assert bench["closed"] == 4


@scenario
def unplugged(bench: Bench) -> None:
    port = bench.open()
    port.write(NOTHING)
    assert port.read(LONG_S)
    bench.set(unplugged=1)
    fails(port.read, "unplugged", "plug it in again, then re-arm")
    fails(lambda: port.read(LONG_S), "unplugged")
    port.close()
    assert bench["is_open"] == 0


@scenario
def a_device_that_hangs_does_not_hold_up_the_loop(bench: Bench) -> None:
    """Were these writes to wait for the device, nobody would come to let it go on."""
    port, codec = bench.open(), CODECS["mbed14"]()
    bench.set(hangs=1)
    port.write(codec.encode((1, 1, 1)))
    while not bench["reports_written"]:
        pass
    for current in (2, 3, 0):
        port.write(codec.encode((current, 0, 0)))
        assert port.read() == b""
    assert port.counts == {WAITED: 3}
    assert bench["reports_written"] == 1
    bench.set(hangs=0)
    while bench["reports_written"] < 2 or bench["left_in_queue"] < 2:
        pass
    assert len(port.read(LONG_S)) == 14
    port.close()
    assert bench["reports_written"] == 2  # the newest alone: what was asked for in between is over
    assert bench.currents == (0, 0, 0)
    assert port.counts["report replaced by a newer one"] == 2


@scenario
def a_port_that_hangs_can_be_closed(bench: Bench) -> None:
    port = bench.open()
    bench.set(hangs=1)
    port.write(NOTHING)
    while not bench["reports_written"]:
        pass
    port.close()
    assert port.counts == {"closed while a report was on its way": 1}
    assert bench["is_open"] == 1  # closing it now would pull it from under the write
    bench.set(hangs=0)
    while bench["is_open"]:
        pass


@scenario
def the_last_report_goes_before_it_is_closed(bench: Bench) -> None:
    for number in range(1, 11):
        port = bench.open()
        port.write(CODECS["mbed14"]().encode((number, 0, 0)))
        port.close()
        assert bench.currents == (number, 0, 0)
        assert not bench["is_open"]


# the driver


def centre() -> tuple[int, int, int]:
    angles = MODEL.kinematics.inverse((0.0, 0.0, 0.0))
    assert angles is not None
    a, b, c = (round(count - home) for count, home in zip(MODEL.drive.counts(angles), MODEL.home_counts, strict=True))
    return a, b, c


def step(bench: Bench, device: ArmDevice, tick: int, force=(0.0, 0.0, 0.0)):
    """A tick, and then time for the wire."""
    sample = device.read(tick)
    device.write(force)
    while not bench["left_in_queue"] and not bench["silent"]:
        pass
    return sample


@scenario
def an_arm_is_opened_read_pushed_and_let_go(bench: Bench) -> None:
    bench.set(stale=1)
    bench.stand_at(centre())
    device = bench.device()
    device.open(1000)
    assert bench.currents == (0, 0, 0)
    samples = [step(bench, device, tick, (1.0, 0.0, 0.0)) for tick in range(5)]
    assert samples[0] is None
    position = samples[-1].position_m
    assert max(map(abs, position)) < MODEL.record.resolution_m, position
    assert samples[-1].age_ticks == 1
    assert device.angles is not None
    expected, _ = MODEL.currents(device.angles, (-1.0, 0.0, 0.0))
    assert bench.currents == expected
    assert expected != (0, 0, 0)
    fails(lambda: (device.read(5), device.write((float("nan"), 0.0, 0.0))), "not finite")
    while not bench["left_in_queue"]:
        pass
    assert bench.currents == (0, 0, 0)
    step(bench, device, 6, (1.0, 0.0, 0.0))
    assert bench.currents == expected
    device.close()
    assert bench.currents == (0, 0, 0)
    assert not bench["is_open"]


@scenario
def an_unplugged_arm_raises_at_every_verb(bench: Bench) -> None:
    bench.stand_at(centre())
    device = bench.device()
    device.open(1000)
    step(bench, device, 0)
    bench.set(unplugged=1)
    for tick in (1, 2):
        fails(lambda tick=tick: device.read(tick), "unplugged")
    device.close()
    device.close()
    assert not bench["is_open"]


@scenario
def a_silent_arm_gets_no_current(bench: Bench) -> None:
    bench.stand_at(centre())
    device = bench.device()
    device.open(1000)
    for tick in range(3):
        step(bench, device, tick, (1.0, 0.0, 0.0))
    assert bench.currents != (0, 0, 0)
    bench.set(silent=1)
    for tick in range(3, 80):
        step(bench, device, tick, (1.0, 0.0, 0.0))
    device.close()
    assert bench.currents == (0, 0, 0)
    assert device.counts["reply missed"] > 50
    assert device.counts["request repeated"] > 5


@scenario
def an_arm_is_calibrated_until_it_is_plugged_in_again(bench: Bench) -> None:
    node = bench.folder / "hidraw5"
    node.touch()
    bench.say(path=str(node))
    bench.set(a=777, b=-20, c=3, info=1)
    notebook = Notebook()
    device = bench.device("pose=stored", notebook)
    fails(lambda: device.open(1000), "its pose is not known")
    notebook.keep(device.calibrate("today"))
    assert (bench["a"], bench["b"], bench["c"]) == (0, 0, 6000)
    assert bench["info"] == 0
    assert bench.currents == (0, 0, 0)
    a, b, c = centre()
    bench.stand_at((a, b, c + 6000))
    device.open(1000)
    step(bench, device, 0)
    device.close()
    node.unlink()
    (bench.folder / "other").touch()
    node.touch()
    fails(lambda: device.open(1000), "plugged in again")


# the tests


@pytest.fixture(scope="session")
def stub(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stub, compiled."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if not sys.platform.startswith("linux"):
        pytest.skip("LD_PRELOAD is Linux's")
    if compiler is None:
        pytest.skip("no C compiler (gcc, cc)")
    library = tmp_path_factory.mktemp("stub") / "hidapi_stub.so"
    subprocess.run(
        [compiler, "-Wall", "-Wextra", "-O1", "-shared", "-fPIC", "-pthread", "-o", library, STUB],
        check=True,
    )
    return library


@pytest.fixture(scope="session")
def outcomes(stub: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, str]]:
    """backend -> scenario -> what went wrong, "" for nothing."""

    def play(module: str) -> dict[str, str]:
        folder = tmp_path_factory.mktemp(module)
        command = [sys.executable, "-W", "error", __file__, str(stub), BACKENDS[module], str(folder)]
        done = subprocess.run(command, env={**os.environ, "LD_PRELOAD": str(stub)}, capture_output=True, timeout=50)
        assert done.returncode == 0, done.stderr.decode()
        result: dict[str, str] = json.loads(done.stdout)
        return result

    return {module: play(module) for module in BACKENDS}


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("module", BACKENDS)
def test_hidapi(outcomes: dict[str, dict[str, str]], module: str, name: str) -> None:
    assert outcomes[module][name] == ""


@pytest.mark.parametrize("backend", ["auto", "hidraw", "libusb"])
def test_the_other_package_of_the_same_name_is_told_apart(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("hid", "hidraw"):
        other = ModuleType(name)
        other.Device = object  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, name, other)
    monkeypatch.setattr(sys, "platform", "linux")
    with pytest.raises(DeviceError, match=r"not of `hidapi`.*pip uninstall hid"):
        HidPort(NAME, VARIANTS["mbed14"], backend).open()


def test_without_the_package_its_name_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("hid", "hidraw"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(
        DeviceError, match=r"hid:woodenhaptics: needs module .* of the package hidapi.*pip install hidapi"
    ):
        HidPort(NAME, VARIANTS["mbed14"]).open()


@pytest.mark.parametrize(
    ("platform", "backend", "module"),
    [
        ("linux", "auto", "hidraw"),
        ("linux", "hidraw", "hidraw"),
        ("linux", "libusb", "hid"),
        ("darwin", "auto", "hid"),
        ("win32", "libusb", "hid"),
    ],
)
def test_each_system_has_its_module(platform: str, backend: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("hid", "hidraw"):
        hidapi = ModuleType(name)
        hidapi.device = object  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, name, hidapi)
    monkeypatch.setattr(sys, "platform", platform)
    assert load_hidapi(backend, NAME).__name__ == module


def test_hidraw_is_linux_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    with pytest.raises(DeviceError, match="backend=hidraw is Linux's"):
        load_hidapi("hidraw", NAME)


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


def main(stub: str, backend: str, folder: str) -> None:
    library = ctypes.CDLL(stub)
    outcomes = {}
    for name, play in SCENARIOS.items():
        own = Path(folder) / name
        own.mkdir()
        try:
            play(Bench(library, backend, own))
        except Exception:  # noqa: BLE001 - the test shows it
            outcomes[name] = traceback.format_exc()
        else:
            outcomes[name] = ""
    print(json.dumps(outcomes))


if __name__ == "__main__":
    main(*sys.argv[1:])
