"""The vendor's SDK in a test's hands: the real package `forcedimension_core` on a stand-in for libdrd, compiled here."""

import ctypes
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from cogrip.devices.forcedimension.family import family
from cogrip.devices.forcedimension.models import TYPES
from cogrip.devices.settings import parse_address

SOURCE = Path(__file__).parent / "stubs" / "libdrd.c"
PACKAGE = "forcedimension_core"
RATE_HZ = 1024
POWER, RESET, FORCE = 0, 3, 5


def make(address: str, axes: int = 3):
    return family().make(parse_address(address), axes, {})


def forget_package() -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
        del sys.modules[name]


@dataclass
class Sdk:
    """The SDK in the test's hands: device 0 is an omega.3, device 1 a Falcon."""

    folder: Path
    lib: ctypes.CDLL

    def device(self, number: int = 0, axes: int = 3, keys: str = "&model=omega3"):
        return make(f"forcedimension:{number}?sdk={self.folder}{keys}", axes)

    def opened(self, number: int = 0, axes: int = 3, keys: str = "&model=omega3"):
        device = self.device(number, axes, keys)
        device.open(RATE_HZ)
        return device

    def force(self, number: int = 0) -> tuple[float, ...]:
        force = (ctypes.c_double * 3)()
        self.lib.stub_force(number, force)
        return tuple(force)

    def move(self, number: int, *position_m: float) -> None:
        self.lib.stub_position(number, *map(ctypes.c_double, position_m))

    def place(self, x_m: float, y_m: float, z_m: float) -> None:
        """Device 0 is there, in the common axes, which are the SDK's."""
        self.move(0, x_m, y_m, z_m)

    def load(self, axes: int = 3) -> tuple[float, ...]:
        """Force with which device 0 loads the hand [N], in the common axes."""
        return tuple(-f for f in self.force()[:axes])

    def step(self, times: int = 1) -> None:
        """Every call is an exchange: nothing has to pass."""

    def become(self, model: str) -> None:
        self.lib.stub_type(0, next(kind for kind, name in TYPES.items() if name == model))

    def journal(self) -> list[str]:
        return self.lib.stub_journal().decode().splitlines()


@pytest.fixture(scope="session")
def libdrd(tmp_path_factory) -> Sdk:
    """An SDK in the folders of the vendor's; a filler for every function that the package looks up and the stand-in has not."""
    if importlib.util.find_spec(PACKAGE) is None:
        pytest.skip("forcedimension-core is not installed")
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: the stand-in for libdrd cannot be made")
    if sys.platform != "linux":
        pytest.skip("the SDK's folders are laid out differently here")
    base = tmp_path_factory.mktemp("libdrd")
    folder = base / "lib" / "release" / f"lin-{platform.machine()}-gcc"
    folder.mkdir(parents=True)
    root = Path(importlib.util.find_spec(PACKAGE).submodule_search_locations[0])
    wanted = set(re.findall(r"_lib(?:dhd|drd)\.(\w+)", "".join(path.read_text() for path in root.rglob("*.py"))))
    fillers = wanted - set(re.findall(r"\b(d[hr]d\w+)\(", SOURCE.read_text()))
    (folder / "fillers.h").write_text("".join(f"int {name}(void) {{ return -1; }}\n" for name in sorted(fillers)))
    flags = ["-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{folder}"]
    path = folder / "libdrd.so.3.16.0"
    subprocess.run([compiler, *flags, "-o", str(path), str(SOURCE), "-lm"], check=True)
    lib = ctypes.CDLL(str(path))
    lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
    return Sdk(base, lib)


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
