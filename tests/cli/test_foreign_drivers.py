"""Defective drivers of other packages: `lab`, `join` and `devices conform` name them in one line, or cope."""

import json
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import Any

import pytest

from cogrip.devices import registry
from cogrip.devices.device import Device
from cogrip.devices.registry import Family, make

from tests.cli.command import Cogrip

LAB = "lab demo --device foreign:x --json -"
Install = Callable[[Callable[[], Any]], None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Make `foreign:` the scheme of a package whose driver this function makes, for any count of axes."""

    def installed(driver: Callable[[], Device]) -> None:
        module = ModuleType("foreign_driver")
        module.family = lambda: Family("foreign", lambda *_: driver(), ("foreign:x",))  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "foreign_driver", module)
        point = EntryPoint("foreign", "foreign_driver:family", registry.GROUP)
        monkeypatch.setattr(registry, "entry_points", lambda group: [point] if group == registry.GROUP else [])
        registry.schemes.cache_clear()

    yield installed
    registry.schemes.cache_clear()


class Broken:
    """A simulated device, one verb of which has a defect."""

    def __init__(self, verb: str) -> None:
        self._device, self._verb = make("sim:phantom?hand=hold"), verb

    def __getattr__(self, name: str) -> Any:
        if name != self._verb:
            return getattr(self._device, name)
        if name == "capability":
            raise IndexError("list index out of range")
        return lambda *_: [][0]


def test_a_driver_needs_as_many_axes_as_the_room_and_is_held_by_its_first(cogrip: Cogrip, install: Install) -> None:
    install(lambda: make("sim:phantom?hand=reach", axes=2))
    for axes in (1, 2):
        answer = json.loads(cogrip.out(f"{LAB} --set seconds=2 --set object.axes={axes}"))
        assert answer["object"]["travel_m"] > 0.005
    err = cogrip.err(f"{LAB} --set object.axes=3")
    assert "anna: sim:phantom has 2 axes, and the room has 3; take another device, or set object.axes=2" in err


@pytest.mark.parametrize("verb", ["capability", "open", "close"])
def test_a_driver_that_fails_before_the_session_is_named(cogrip: Cogrip, install: Install, verb: str) -> None:
    install(lambda: Broken(verb))
    err = cogrip.err(LAB)
    assert f"anna: 'foreign:x': IndexError: list index out of range in {verb}; its driver has a defect" in err
    assert len(err.strip().splitlines()) == 1


def test_a_driver_that_cannot_be_made_is_named(cogrip: Cogrip, install: Install) -> None:
    def fails() -> Device:
        raise OSError("no such library")

    install(fails)
    for command in (LAB, "join 127.0.0.1:1 --device foreign:x", "devices conform foreign:x"):
        assert "'foreign:x': OSError: no such library in make; its driver has a defect" in cogrip.err(command)


@pytest.mark.parametrize("verb", ["read", "write"])
def test_a_driver_that_fails_in_the_session_ends_it_in_a_fault(cogrip: Cogrip, install: Install, verb: str) -> None:
    install(lambda: Broken(verb))
    anna = json.loads(cogrip.out(f"{LAB} --set seconds=1", code=1))["users"][0]
    assert anna["state"] == "fault"
    assert f"device: sim: IndexError: list index out of range in {verb}" in anna["reason"]


def test_conform_reports_a_defect_and_continues(cogrip: Cogrip, install: Install) -> None:
    install(lambda: Broken("write"))
    out = cogrip.out("devices conform foreign:x --axes 1", code=1)
    assert "✗ samples_are_metres: only DeviceError may be raised, not IndexError: list index out of range" in out
    assert "✗ raises_device_errors_alone: a force of" in out
    assert "✓ record_is_complete" in out
