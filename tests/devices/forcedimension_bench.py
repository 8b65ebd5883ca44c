"""The vendor's SDK in a test's hands: the real package `forcedimension_core` on a stand-in for libdrd, compiled here."""

import ctypes
import importlib.util
import platform
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from cogrip.devices.device import Device
from cogrip.devices.forcedimension.models import TYPES

from tests.devices.compiled_stub import STUBS, compile_stub
from tests.devices.vendor_bench import VendorBench

SOURCE = STUBS / "libdrd.c"
PACKAGE = "forcedimension_core"
RATE_HZ = 1024
POWER, RESET, FORCE, TORQUE, ERROR = 0, 3, 5, 7, 9


def forget_package() -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


@dataclass
class Sdk(VendorBench):
    """The SDK in the test's hands: device 0 is an omega.3, device 1 a Falcon."""

    folder: Path
    rate_hz = RATE_HZ
    default_keys = "&model=omega3"

    def address(self, number: int) -> str:
        return f"forcedimension:{number}?sdk={self.folder}"

    def place(self, x_m: float, y_m: float, z_m: float) -> None:
        """Device 0 is there, in the common axes, which are the SDK's."""
        self.move(0, x_m, y_m, z_m)

    def load(self, axes: int = 3) -> tuple[float, ...]:
        """Force with which device 0 loads the hand [N], in the common axes."""
        return tuple(-f for f in self.force()[:axes])

    def own(self) -> tuple[float, ...]:
        """Torque on the hand at device 0 [N m], and the force that opens its gripper, or closes a left-handed one [N]."""
        own = (ctypes.c_double * 4)()
        self.lib.stub_own(0, own)
        return tuple(own)

    def step(self, times: int = 1) -> None:
        """Every call is an exchange: nothing has to pass."""

    def ticked(self, device: Device, tick: int, force_n: tuple[float, ...]) -> Sequence[float] | None:
        """Return what the device says that acts, after a tick of a loop."""
        device.read(tick)
        return device.write(force_n)

    def become(self, model: str) -> None:
        self.lib.stub_type(0, next(kind for kind, name in TYPES.items() if name == model))


@pytest.fixture(scope="session")
def libdrd(tmp_path_factory) -> Sdk:
    """An SDK in the folders of the vendor's; a filler for every function that the package looks up and the stand-in has not."""
    if importlib.util.find_spec(PACKAGE) is None:
        pytest.skip("forcedimension-core is not installed")
    if sys.platform != "linux":
        pytest.skip("the SDK's folders are laid out differently here")
    base = tmp_path_factory.mktemp("libdrd")
    folder = base / "lib" / "release" / f"lin-{platform.machine()}-gcc"
    folder.mkdir(parents=True)
    root = Path(importlib.util.find_spec(PACKAGE).submodule_search_locations[0])
    wanted = set(re.findall(r"_lib(?:dhd|drd)\.(\w+)", "".join(path.read_text() for path in root.rglob("*.py"))))
    fillers = wanted - set(re.findall(r"\b(d[hr]d\w+)\(", SOURCE.read_text()))
    (folder / "fillers.h").write_text("".join(f"int {name}(void) {{ return -1; }}\n" for name in sorted(fillers)))
    path = compile_stub(SOURCE, folder / "libdrd.so.3.16.0", "-Werror", f"-I{folder}", "-lm")
    lib = ctypes.CDLL(str(path))
    lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
    return Sdk(lib, base)


@pytest.fixture(scope="module")
def loadable(libdrd):
    """For the tests of a module the package is imported once, which takes longer than most of them."""
    forget_package()
    yield libdrd
    forget_package()


@pytest.fixture
def sdk(loadable):
    """The SDK as it was when it was loaded."""
    loadable.lib.stub_reset()
    yield loadable
    assert loadable.lib.stub_wrongs().decode() == ""
