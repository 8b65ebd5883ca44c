"""The real package hidapi on a stub of the C library beneath it, in a scenario's hands; scenarios assert."""

import ctypes
from collections.abc import Callable
from pathlib import Path

from cogrip.devices.arm.driver import ArmDevice
from cogrip.devices.emulated.emulated_device import Notebook
from cogrip.devices.family.hid import drive
from cogrip.devices.hid.enumeration import VARIANTS
from cogrip.devices.io.hid_line import HidLine
from cogrip.devices.settings import parse_address

from tests.devices.held_device import refused

NAME = "hid:woodenhaptics"
NOTHING = bytes(15)
LONG_S = 20.0  # a wait that ends when what it waits for is there
# The stub's reply may be here before the thread that wrote knows that it did.
WAITED = "report waits for the one before"


class Bench:
    """The stub's knobs, and what is driven."""

    def __init__(self, stub: ctypes.CDLL, backend: str, folder: Path) -> None:
        self._stub = stub
        self.backend = backend
        self.folder = folder
        self._ports: list[HidLine] = []
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

    def line(self, variant: str = "mbed14", **asked: str) -> HidLine:
        return HidLine(NAME, VARIANTS[variant], self.backend, **asked)

    def open(self, variant: str = "mbed14", **asked: str) -> HidLine:
        line = self.line(variant, **asked)
        line.open()
        self._ports.append(line)
        return line

    def close(self) -> None:
        for line in self._ports:
            line.close()

    def device(self, keys: str = "pose=home", notebook: Notebook | None = None) -> ArmDevice:
        address = parse_address(f"{NAME}?backend={self.backend}&{keys}")
        return drive(self.line(), NAME, notebook or Notebook(), address, 3)

    def stand_at(self, counts) -> None:
        self.set(**dict(zip("abc", map(round, counts), strict=True)))


def fails(verb: Callable[[], object], *says: str) -> None:
    with refused(*says):
        verb()


def fails_at_last(line: HidLine, *says: str) -> None:
    """A failure in the writing thread is raised by a later call."""
    fails(lambda: [line.read(0.05) for _ in range(100)], *says)
