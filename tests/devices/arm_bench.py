"""An arm's driver on its emulated firmware, both at hand. Virtual time."""

from collections.abc import Sequence
from math import hypot

from cogrip.devices.arm.pose import Calibration
from cogrip.devices.device import DeviceError, Sample
from cogrip.devices.emulated.emulated_device import EmulatedDevice, Notebook
from cogrip.devices.emulated.emulated_line import EmulatedLine
from cogrip.devices.emulated.firmware import Firmware
from cogrip.devices.emulated.hfab_firmware import HfabFirmware
from cogrip.devices.family.machines import make_firmware
from cogrip.devices.family.serial import drive
from cogrip.devices.settings import parse_address

RATE_HZ = 1024
NAME = "serial:/dev/test"
NO_FORCE = (0.0, 0.0, 0.0)


class Bench(EmulatedDevice):
    """A driver on its firmware, both at hand; `hold` runs the loop on."""

    def __init__(
        self, name: str = "vintage", keys: str = "pose=home", hand: str = "hold", axes: int = 3, store: Notebook | None = None,
        powered_at_m: tuple[float, float, float] | None = None, arm: HfabFirmware | None = None,
    ) -> None:  # fmt: skip
        arm = arm or make_firmware(name, parse_address(f"sim:phantom?hand={hand}").query, powered_at_m=powered_at_m)
        self.notebook = store or Notebook()
        self.line = EmulatedLine(NAME, arm)
        driver = drive(self.line, NAME, self.notebook, parse_address(f"{NAME}?{keys}"), axes)
        super().__init__(driver, arm)
        self.arm = arm
        self.tick = 0
        self.sent: list[bytes] = []
        write = self.line.write
        self.line.write = lambda frame: (self.sent.append(frame), write(frame))  # type: ignore[method-assign]

    def hold(self, force_n: Sequence[float], ticks: int) -> list[Sample | None]:
        samples = []
        for _ in range(ticks):
            samples.append(self.read(self.tick))
            self.write(force_n)
            self.tick += 1
        return samples

    def fails(self, force_n: Sequence[float], ticks: int) -> tuple[str, int, list[float]]:
        """The first failure, the ticks until then, and the size of the force; whatever happens the loop goes on."""
        said, when, sizes = "", -1, []
        for number in range(ticks):
            for verb in (lambda: self.read(self.tick), lambda: self.write(force_n)):
                try:
                    verb()
                except DeviceError as error:
                    said, when = said or str(error), when if said else number
            sizes.append(hypot(*self.arm.mechanics.force_n))
            self.tick += 1
        return said, when, sizes

    def go_home(self) -> None:
        self.arm.mechanics.carry(self.arm.mechanics.home_m)

    def calibrate(self, made: str = "today") -> Calibration:
        calibration = self.driver.calibrate(made)
        self.notebook.keep(calibration)
        return calibration


def opened(*arguments, **keys) -> Bench:
    bench = Bench(*arguments, **keys)
    bench.open(RATE_HZ)
    return bench


def least_force_n(arm: Firmware) -> float:
    """Force of one milliampere of every motor here: truncation may leave out so much."""
    least = 0.0
    for currents in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        arm.mechanics.drive(currents)
        least += hypot(*arm.mechanics.force_n)
    arm.mechanics.drive(NO_FORCE)
    return least
