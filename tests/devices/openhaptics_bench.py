"""The library libHD in a test's hands: a stand-in of its own for each test, and devices on it."""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.devices.vendor_bench import VendorBench

RATE_HZ = 1000
NAMES = ("Default Device", "Left Device", "Right Device")


@dataclass
class Bench(VendorBench):
    """The library in the test's hands. Devices are numbered as in NAMES."""

    path: Path
    rate_hz = RATE_HZ

    def address(self, number: int) -> str:
        return f"openhaptics:{NAMES[number]}?library={self.path}"

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.lib.stub_step()

    def pushed(self) -> Any:
        """Device 0, which has been asked for 1 N along x for a frame."""
        device = self.opened()
        device.write((1.0, 0.0, 0.0))
        self.step()
        return device

    def place(self, x_m: float, y_m: float, z_m: float) -> None:
        """Device 0 is there, in the common axes."""
        self.move(0, 1e3 * y_m, 1e3 * z_m, 1e3 * x_m)

    def load(self, axes: int = 3) -> tuple[float, ...]:
        """Force with which device 0 loads the hand [N], in the common axes."""
        right, up, near = self.force()
        return (-near, -right, -up)[:axes]

    def call_itself(self, name: str, *limits: float, number: int = 0) -> None:
        """limits: peak and continuous force [N], stiffness [N/mm]."""
        self.lib.stub_model(number, name.encode(), *map(ctypes.c_double, limits))

    def become(self, model: str) -> None:
        if model != "touch":
            self.call_itself("Phantom Premium 1.5", 8.5, 1.4, 3.5)
