"""`forcedimension:` through the real package `forcedimension_core`, on a stand-in for libdrd compiled here."""

import importlib.util
import os
import sys
from ctypes import c_double

import pytest

from cogrip.devices.device import DeviceError
from cogrip.devices.forcedimension.forcedimension_device import STATUS_TICKS
from cogrip.devices.forcedimension.models import RECORDS, TYPES

from tests.devices.forcedimension_bench import ERROR, FORCE, PACKAGE, POWER, RATE_HZ, RESET, forget_package
from tests.devices.held_device import opened, refused
from tests.devices.vendor_bench import end_without_closing


def test_order_of_use(sdk) -> None:
    device = sdk.flowing()
    device.write((1.0, 0.0, 0.0))
    device.close()
    device.close()
    assert sdk.journal() == ["open 0", "limit 12 0", "watchdog 255 0", "enable 1 0", "stop 0", "close 0"]
    assert sdk.lib.stub_expert() == 0
    assert device.counts == {}


def test_a_device_is_opened_once_in_a_process(sdk) -> None:
    """The SDK would give it to both."""
    first, second = sdk.opened(), sdk.device()
    with pytest.raises(DeviceError, match="open already in this process"):
        second.open(RATE_HZ)
    second.close()
    assert first.read(0) is not None
    first.close()
    second.open(RATE_HZ)
    second.close()


@pytest.mark.parametrize(
    ("number", "keys", "words"),
    [
        (0, "&model=delta3", "it is model=omega3, not delta3; correct the key model"),
        (1, "&model=omega3", "it is model=falcon, not omega3"),
        (5, "", "forcedimension:5: is not to be had: no device found; check its cable"),
    ],
)
def test_another_device_is_refused(sdk, number, keys, words) -> None:
    with pytest.raises(DeviceError, match=words):
        sdk.opened(number, keys=keys)
    assert not [line for line in sdk.journal() if line.startswith("enable")]
    assert not sdk.journal() or number == 5 or sdk.journal()[-1] == f"close {number}"


def test_unknown_devices_are_refused(sdk) -> None:
    for kind, words in (
        (-1, "does not say what it is"),
        (77, "type 77, which is not known"),
        (81, "type 81, which is not known"),
    ):
        sdk.lib.stub_type(0, kind)
        with pytest.raises(DeviceError, match=words):
            sdk.opened(keys="")


@pytest.mark.parametrize(
    ("kind", "model", "most_n"), [(64, "delta6", 20.0), (106, "sigma6", 12.0), (107, "sigma6", 12.0)]
)
def test_kinds_that_the_package_has_no_name_for_are_driven(sdk, kind: int, model: str, most_n: float) -> None:
    sdk.lib.stub_type(0, kind)
    device = sdk.flowing(keys=f"&model={model}")
    assert (device.capability.model, device.capability.gives_orientation) == (model, True)
    device.write((100.0, 0.0, 0.0))
    assert sdk.force() == (-most_n, 0.0, 0.0)
    device.close()


def test_model_that_is_not_stated_has_the_limits_of_the_weakest(sdk) -> None:
    device = sdk.flowing(keys="")
    device.write((12.0, 0.0, 0.0))
    assert sdk.force() == (-8.0, 0.0, 0.0)
    device.close()
    assert "limit 8 0" in sdk.journal()


@pytest.mark.parametrize(("which", "value", "words"), [(RESET, 1, "is not calibrated"), (POWER, 0, "is switched off")])
def test_no_force_before_it_is_on_and_calibrated(sdk, which, value, words) -> None:
    sdk.lib.stub_status(0, which, value)
    device = sdk.device()
    with pytest.raises(DeviceError, match=rf"{words}.*calibrate it with the vendor's program"):
        device.open(RATE_HZ)
    assert [line for line in sdk.journal() if not line.startswith(("open", "stop", "close"))] == []
    sdk.lib.stub_status(0, which, 1 - value)
    device.open(RATE_HZ)
    device.close()


@pytest.mark.parametrize(
    ("verb", "words"),
    [
        ("open", "is not to be had"), ("status", "its state cannot be read"),
        ("limit", "its force cannot be limited"), ("force", "its force cannot be set"),
        ("type", "does not say what it is"),
    ],
)  # fmt: skip
def test_whatever_fails_at_opening_leaves_it_closed(sdk, verb, words) -> None:
    device = sdk.device()
    sdk.lib.stub_fail(verb.encode())
    with pytest.raises(DeviceError, match=words):
        device.open(RATE_HZ)
    sdk.lib.stub_fail(b"")
    with pytest.raises(DeviceError, match="call open"):
        device.read(0)
    device.open(RATE_HZ)
    device.close()


def test_what_the_controller_could_not_do_is_counted(sdk) -> None:
    sdk.lib.stub_fail(b"watchdog")
    device = sdk.opened()
    sdk.lib.stub_fail(b"")
    assert sdk.lib.stub_expert() == 0
    sdk.lib.stub_guarded(0, 1)
    sdk.lib.stub_saturated(0, 1)
    assert device.read(1) is not None
    device.write((1.0, 0.0, 0.0))
    assert device.counts == {"watchdog not available": 1, "position read again too soon": 1, "motor saturated": 1}
    device.close()


@pytest.mark.parametrize("wait_ms", [0, 38, 715])
def test_forces_flow_however_long_a_client_takes_to_its_first_force(sdk, wait_ms: int) -> None:
    """Its watchdog has 32 ms: forces that were enabled by `open` were off before the first one came, and stayed off."""
    device = sdk.opened()
    sdk.lib.stub_wait(wait_ms)
    told = [sdk.ticked(device, tick, (1.0, 0.0, 0.0)) for tick in range(100)]
    assert sdk.load() == (1.0, 0.0, 0.0)
    assert told == [(0.0, 0.0, 0.0)] * 2 + [None] * 98, "what acts, tick by tick"
    assert device.counts == {}
    device.close()


@pytest.mark.parametrize(("pause_ms", "off"), [(20, False), (31, False), (33, True), (90, True)])
def test_a_pause_of_the_loop_longer_than_the_watchdog_ends_in_forces_that_are_on(sdk, pause_ms: int, off: bool) -> None:
    device = sdk.flowing()
    sdk.ticked(device, 10, (1.0, 0.0, 0.0))
    sdk.lib.stub_wait(pause_ms - 1)
    assert sdk.load()[0] == (0.0 if pause_ms > 32 else 1.0)
    told = [sdk.ticked(device, 10 + pause_ms + tick, (1.0, 0.0, 0.0)) for tick in range(60)]
    assert sdk.load() == (1.0, 0.0, 0.0)
    assert told.count((0.0, 0.0, 0.0)) == (22 if off else 0), "20 ms at rest, and 2 to see whether forces are on"
    assert device.counts == ({"forces off": 1} if off else {})
    device.close()


@pytest.mark.parametrize(
    ("cause", "words"),
    [(1, "the button on its base"), (2, "it moved too fast"), (6, "nobody holds it"), (0, "it does not say why")],
)
def test_forces_that_were_switched_off_are_a_fault_that_says_why(sdk, cause: int, words: str) -> None:
    device = sdk.flowing()
    sdk.lib.stub_off(0, cause)
    with pytest.raises(DeviceError, match=f"lost: its controller has switched the forces off .{words}"):
        [sdk.ticked(device, tick, (1.0, 0.0, 0.0)) for tick in range(3, 3 + STATUS_TICKS + 1)]
    assert device.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    sdk.lib.stub_status(0, FORCE, 1)  # the button again
    with pytest.raises(DeviceError, match="lost"):
        device.read(40)
    assert device.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert sdk.force() == (0.0, 0.0, 0.0)
    device.close()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda lib: lib.stub_power_off(0), "its power is gone"),
        (lambda lib: lib.stub_status(0, ERROR, 1), "its controller reports an error"),
        (lambda lib: lib.stub_status(0, RESET, 1), "it is not calibrated any more"),
    ],
)
def test_a_controller_that_is_not_well_is_a_fault(sdk, spoil, words: str) -> None:
    device = sdk.flowing()
    spoil(sdk.lib)
    with pytest.raises(DeviceError, match=words):
        [sdk.ticked(device, tick, (1.0, 0.0, 0.0)) for tick in range(3, 3 + STATUS_TICKS + 1)]
    assert device.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    device.close()


def test_forces_that_cannot_be_enabled_are_a_fault(sdk) -> None:
    device = sdk.opened()
    sdk.lib.stub_fail(b"enable")
    assert sdk.ticked(device, 0, (1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    with pytest.raises(DeviceError, match="its forces cannot be enabled"):
        device.read(1)
    device.close()


@pytest.mark.parametrize("verb", ["position", "force", "status"])
def test_lost_device_says_so_and_has_no_force(sdk, verb) -> None:
    device, other = sdk.flowing(), sdk.flowing(1, keys="")
    device.write((1.0, 0.0, 0.0))
    other.write((1.0, 0.0, 0.0))
    sdk.lib.stub_fail(verb.encode())
    if verb == "force":
        device.write((2.0, 0.0, 0.0))
    with pytest.raises(DeviceError, match="forcedimension:0: lost: no device found; check its cable and power"):
        device.read(200)
    sdk.lib.stub_fail(b"")
    with pytest.raises(DeviceError, match="lost"):
        device.read(201)
    assert device.write((1.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert sdk.force(0) == (0.0, 0.0, 0.0)
    assert other.read(201) is not None
    assert sdk.force(1) == (-1.0, 0.0, 0.0)
    other.close()
    device.close()
    device.open(RATE_HZ)
    assert device.read(0) is not None
    device.close()


def test_a_position_that_freezes_while_the_velocity_goes_on_is_lost(sdk) -> None:
    """More than 3 mm and eight counts. A velocity of 10 mm/s may be noise."""
    device = sdk.flowing()
    sdk.lib.stub_velocity(0, *map(c_double, (0.1, 0.0, 0.0)))
    with pytest.raises(
        DeviceError, match=r"its position stands still, and its own velocity of 0\.1 m/s has gone 3\.1 mm"
    ):
        [sdk.ticked(device, tick, (1.0, 0.0, 0.0)) for tick in range(3, 200)]
    device.close()
    sdk.lib.stub_velocity(0, *map(c_double, (0.0, 0.0, 0.01)))
    device = sdk.flowing()
    assert all(sdk.ticked(device, tick, (1.0, 0.0, 0.0)) is None for tick in range(3, 1000)), "one that rests"
    device.close()


def test_close_never_raises(sdk) -> None:
    for verb in (b"stop", b"close"):
        device = sdk.opened()
        sdk.lib.stub_fail(verb)
        device.close()
        assert device.counts == {"error at close": 1}
        assert sdk.force() == (0.0, 0.0, 0.0)
        sdk.lib.stub_fail(b"")


@pytest.mark.sample(1)
@pytest.mark.parametrize("end", ["pass", "raise KeyboardInterrupt"])
def test_process_that_ends_without_closing(sdk, end) -> None:
    path = next(sdk.folder.rglob("libdrd.so.*"))
    said = end_without_closing(
        sdk.address(0) + "&model=omega3", path, "print(lib.stub_journal().split(), lib.stub_wrongs())", end
    )
    assert said[-1].endswith("b'stop', b'0', b'close', b'0'] b''")


def test_sdk_that_is_too_old(sdk, capfd) -> None:
    """The package says so on the terminal; it stands in the error instead."""
    sdk.lib.stub_version(3, 15)
    forget_package()
    with pytest.raises(DeviceError, match=r"cannot be loaded \(Invalid version. v3.15.*3.16.*sdk=FOLDER or in FDSDK"):
        sdk.opened()
    assert capfd.readouterr().err == ""


@pytest.mark.skipif(importlib.util.find_spec(PACKAGE) is None, reason="forcedimension-core is not installed")
def test_sdk_that_is_not_there(monkeypatch) -> None:
    forget_package()
    monkeypatch.setenv("__fdsdkpy_unittest_runtime__", "True")  # it then finds none, wherever one may be installed
    with pytest.raises(DeviceError, match=r"the SDK cannot be loaded .*install the vendor's SDK, 3.16 or later"):
        opened("forcedimension:0")
    forget_package()


def test_package_that_is_not_there(monkeypatch) -> None:
    forget_package()
    monkeypatch.setitem(sys.modules, PACKAGE, None)
    with refused("needs the package 'forcedimension_core", "pip install 'cogrip[forcedimension]'"):
        opened("forcedimension:0")


def test_another_sdk_than_the_one_loaded_is_refused(sdk, tmp_path) -> None:
    sdk.opened().close()
    with pytest.raises(DeviceError, match=r"sdk=.*other has no library, or .*libdrd.so.3.16.0 was loaded before"):
        opened(f"forcedimension:0?sdk={tmp_path}/other")


def test_types_are_those_of_the_package_and_the_environment_is_left_as_it_was(sdk, monkeypatch) -> None:
    monkeypatch.setenv("FDSDK", "/elsewhere")
    sdk.opened().close()
    assert os.environ["FDSDK"] == "/elsewhere"
    kinds = {int(kind): kind.name for kind in sys.modules[f"{PACKAGE}.constants"].DeviceType}
    of_the_header = {64: "delta6", 106: "sigma6", 107: "sigma6"}
    assert not of_the_header.keys() & kinds.keys()
    assert of_the_header.items() <= TYPES.items()
    for number, model in TYPES.items() - of_the_header.items():
        assert kinds[number].replace("_RIGHT", "").replace("_LEFT", "").lower() == model
    assert set(TYPES.values()) == set(RECORDS)
