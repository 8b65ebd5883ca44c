"""A vendor's library in a test's hands: a stand-in compiled here, and devices on it, each at its number."""

import ctypes
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from cogrip.devices.registry import make

FIRST_TICKS = 3  # The first ticks of a loop; forces flow after them.


@dataclass
class VendorBench:
    """Forces and positions are in the library's own axes and units. address: of a device, by its number."""

    lib: ctypes.CDLL
    rate_hz: ClassVar[int]
    default_keys: ClassVar[str] = ""

    def address(self, number: int) -> str:
        raise NotImplementedError

    def device(self, number: int = 0, axes: int = 3, keys: str | None = None) -> Any:
        return make(self.address(number) + (self.default_keys if keys is None else keys), axes=axes)

    def opened(self, number: int = 0, axes: int = 3, keys: str | None = None) -> Any:
        device = self.device(number, axes, keys)
        device.open(self.rate_hz)
        return device

    def flowing(self, number: int = 0, axes: int = 3, keys: str | None = None) -> Any:
        """A device that has been open for some ticks, so that forces flow."""
        device = self.opened(number, axes, keys)
        for tick in range(FIRST_TICKS):
            device.read(tick)
            device.write((0.0,) * axes)
            self.step()
        return device

    def step(self, times: int = 1) -> None:
        raise NotImplementedError

    def force(self, number: int = 0) -> tuple[float, ...]:
        force = (ctypes.c_double * 3)()
        self.lib.stub_force(number, force)
        return tuple(force)

    def move(self, number: int, *position: float) -> None:
        self.lib.stub_position(number, *map(ctypes.c_double, position))

    def journal(self) -> list[str]:
        return self.lib.stub_journal().decode().splitlines()


SCRIPT = """
import atexit, ctypes, sys
from cogrip.devices.registry import make
address, path, tell, end = sys.argv[1:]
device = make(address, axes=3)
lib = ctypes.CDLL(path)
lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
atexit.register(exec, tell, globals())  # runs last
device.open(1000)
for tick in range(4):
    device.read(tick)
    device.write((1.0, 0.0, 0.0))
exec(end)
"""


def end_without_closing(address: str, library: Path, tell: str, end: str) -> list[str]:
    """Return the lines of a process that pushes and comes to this end. tell: what it does when all else is over."""
    command = [sys.executable, "-c", SCRIPT, address, str(library), tell, end]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.splitlines()
