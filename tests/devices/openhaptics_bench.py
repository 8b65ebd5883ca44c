"""The library libHD in a test's hands: a stand-in of its own for each test, and devices on it."""

import ctypes
from dataclasses import dataclass
from pathlib import Path

from cogrip.devices.openhaptics.family import family
from cogrip.devices.settings import parse_address

RATE_HZ = 1000
NAMES = ("Default Device", "Left Device", "Right Device")


def make(address: str, axes: int = 3):
    return family().make(parse_address(address), axes, {})


@dataclass
class Bench:
    """The library in the test's hands. Devices are numbered as in NAMES; forces and positions are in the library's axes."""

    path: Path
    lib: ctypes.CDLL

    def device(self, number: int = 0, axes: int = 3, keys: str = ""):
        return make(f"openhaptics:{NAMES[number]}?library={self.path}{keys}", axes)

    def opened(self, number: int = 0, axes: int = 3, keys: str = ""):
        device = self.device(number, axes, keys)
        device.open(RATE_HZ)
        return device

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.lib.stub_step()

    def force(self, number: int = 0) -> tuple[float, ...]:
        force = (ctypes.c_double * 3)()
        self.lib.stub_force(number, force)
        return tuple(force)

    def move(self, number: int, *position_mm: float) -> None:
        self.lib.stub_position(number, *map(ctypes.c_double, position_mm))

    def place(self, x_m: float, y_m: float, z_m: float) -> None:
        """Device 0 is there, in the common axes."""
        self.move(0, 1e3 * y_m, 1e3 * z_m, 1e3 * x_m)

    def load(self, axes: int = 3) -> tuple[float, ...]:
        """Force with which device 0 loads the hand [N], in the common axes."""
        right, up, near = self.force()
        return (-near, -right, -up)[:axes]

    def become(self, model: str) -> None:
        if model != "touch":
            self.lib.stub_model(0, b"Phantom Premium 1.5", *map(ctypes.c_double, (8.5, 1.4, 3.5)))

    def journal(self) -> list[str]:
        return self.lib.stub_journal().decode().splitlines()
