"""`openhaptics:`: the library is bound, asked in its order, and calibrated before any force."""

import ctypes

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.io.hd_library import SIGNATURES, ErrorInfo, load

from tests.devices.compiled_stub import compile_stub
from tests.devices.openhaptics_bench import RATE_HZ, make


def test_types_are_those_of_the_headers(bench) -> None:
    assert ctypes.sizeof(ErrorInfo) == 12
    hd = load(str(bench.path))
    for name, (result, arguments) in SIGNATURES.items():
        assert getattr(hd, name).restype is result
        assert getattr(hd, name).argtypes == arguments
    bench.lib.stub_error_of_nobody(0x302)
    error = hd.hdGetError()
    assert (error.code, error.internal, error.handle) == (0x302, -7, 0xFFFFFFFF)
    assert hd.hdGetError().code == 0


def test_library_that_is_not_there_or_another_one(tmp_path) -> None:
    device = make(f"openhaptics:x?library={tmp_path}/libHD.so")
    with pytest.raises(DeviceError, match=r"cannot be loaded.*library=PATH"):
        device.open(RATE_HZ)
    source = tmp_path / "other.c"
    source.write_text("int hdInitDevice(void) { return 0; }")
    other = compile_stub(source, tmp_path / "libother.so", "-Werror")
    with pytest.raises(DeviceError, match="has no hdDisableDevice: it is not the OpenHaptics HD library"):
        make(f"openhaptics:x?library={other}").open(RATE_HZ)


def test_order_of_use(bench) -> None:
    device = bench.opened()
    bench.step(2)
    device.close()
    name = "Default Device"
    assert bench.journal() == [
        f"init {name}",
        "start",
        f"check calibration {name}",
        f"enable {name}",
        "schedule 65535",
        f"disable {name}",
        "stop",
        "unschedule",
        f"disable device {name}",
    ]


def test_no_name_is_the_default_device(bench) -> None:
    device = make(f"openhaptics:?library={bench.path}")
    device.open(RATE_HZ)
    device.close()
    assert bench.journal()[0] == "init NULL"


def test_name_that_the_vendors_settings_do_not_have(bench) -> None:
    device = make(f"openhaptics:Nobody?library={bench.path}")
    with pytest.raises(DeviceError, match=r"openhaptics:Nobody: is not to be had: No such device.*0x303.*GTDD_HOME"):
        device.open(RATE_HZ)
    device.close()
    with pytest.raises(DeviceError, match="call open"):
        device.read(0)


def test_device_that_is_open_already_stays_open(bench) -> None:
    first = bench.opened()
    with pytest.raises(DeviceError, match="is open already as openhaptics:Default Device; close that one first"):
        bench.device().open(RATE_HZ)
    first.write((1.0, 0.0, 0.0))
    bench.step()
    assert first.read(1) is not None
    assert bench.force() == (0.0, 0.0, -1.0)
    first.close()


@pytest.mark.parametrize(("styles", "style"), [(2, 2), (4, 4), (6, 2), (5, 4)])
def test_calibration_that_the_library_can_do_itself(bench, styles, style) -> None:
    bench.lib.stub_calibration(0, 0x5001, styles, 3)
    device = bench.opened()
    lines = bench.journal()
    assert lines.count(f"update calibration Default Device {style}") == 3
    assert lines.index("enable Default Device") > lines.index(f"update calibration Default Device {style}")
    device.close()


@pytest.mark.parametrize(
    ("state", "style", "updates", "words"),
    [
        (0x5002, 4, 0, "by hand: put the stylus into the inkwell"),
        (0x5002, 2, 0, "by hand: move the arm slowly"),
        (0x5002, 1, 0, "by hand: bring all links to right angles"),
        (0x5001, 1, 1, "needs to be calibrated: bring all links to right angles"),
        (0x5001, 4, 1000, "needs to be calibrated: put the stylus"),
        (0x1234, 4, 0, r"unknown state of calibration \(0x1234\)"),
    ],
)
def test_no_force_before_it_is_calibrated(bench, state, style, updates, words) -> None:
    bench.lib.stub_calibration(0, state, style, updates)
    device = bench.device()
    with pytest.raises(DeviceError, match=words):
        device.open(RATE_HZ)
    assert not [line for line in bench.journal() if line.startswith(("enable", "schedule", "update")) and style == 1]
    assert "enable Default Device" not in bench.journal()
    bench.lib.stub_calibration(0, 0x5000, style, 0)
    device.open(RATE_HZ)
    device.close()
