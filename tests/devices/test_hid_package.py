"""The package hidapi: which of its modules is loaded, and what is said of one that is not there."""

import sys
from types import ModuleType

import pytest

from cogrip.devices.hid.enumeration import VARIANTS
from cogrip.devices.io import platform
from cogrip.devices.io.hid_line import HidLine, load_hidapi

from tests.devices.held_device import refused
from tests.devices.hid_bench import NAME


def put(monkeypatch: pytest.MonkeyPatch, **keys: object) -> None:
    """Have modules `hid` and `hidraw` with these names in them; none: they are not there."""
    for name in ("hid", "hidraw"):
        module = ModuleType(name) if keys else None
        vars(module).update(keys) if module else None
        monkeypatch.setitem(sys.modules, name, module)


@pytest.mark.parametrize("backend", ["auto", "hidraw", "libusb"])
def test_without_the_package_its_name_is_said_and_another_of_that_name_is_told_apart(
    backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(platform, "LINUX", True)
    port = HidLine(NAME, VARIANTS["mbed14"], backend)
    put(monkeypatch)
    with refused("hid:woodenhaptics: needs module ", " of the package hidapi", "pip install hidapi"):
        port.open()
    put(monkeypatch, Device=object)
    with refused("not of `hidapi`", "pip uninstall hid"):
        port.open()


@pytest.mark.parametrize(
    ("linux", "backend", "module"),
    [
        (True, "auto", "hidraw"), (True, "hidraw", "hidraw"), (True, "libusb", "hid"),
        (False, "auto", "hid"), (False, "libusb", "hid"),
    ],
)  # fmt: skip
def test_each_system_has_its_module(linux: bool, backend: str, module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    put(monkeypatch, device=object)
    monkeypatch.setattr(platform, "LINUX", linux)
    assert load_hidapi(backend, NAME).__name__ == module
    if not linux:
        with refused("backend=hidraw is Linux's"):
            load_hidapi("hidraw", NAME)
