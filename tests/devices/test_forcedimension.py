"""`forcedimension:` through the real package `forcedimension_core`, on a stand-in for libdrd compiled here."""

import ctypes
import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from math import hypot, inf, nan
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cogrip.devices.conformance import CHECKS, Subject
from cogrip.devices.device import DeviceError
from cogrip.devices.forcedimension.family import family
from cogrip.devices.forcedimension.models import RECORDS, TYPES
from cogrip.devices.settings import parse_address

from tests.devices.moved_evenly import ends_softly, forces_over_a_jump

SOURCE = Path(__file__).parent / "stubs" / "libdrd.c"
PACKAGE = "forcedimension_core"
RATE_HZ = 1024
POWER, RESET, FORCE = 0, 3, 5

needs_package = pytest.mark.skipif(
    importlib.util.find_spec(PACKAGE) is None, reason="forcedimension-core is not installed"
)


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

    def journal(self) -> list[str]:
        return self.lib.stub_journal().decode().splitlines()


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """The library, with a filler for every function that the package looks up and the stand-in does not have."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler: the stand-in for libdrd cannot be made")
    if sys.platform != "linux":
        pytest.skip("the SDK's folders are laid out differently here")
    folder = tmp_path_factory.mktemp("libdrd")
    root = Path(importlib.util.find_spec(PACKAGE).submodule_search_locations[0])
    wanted = set(re.findall(r"_lib(?:dhd|drd)\.(\w+)", "".join(path.read_text() for path in root.rglob("*.py"))))
    fillers = wanted - set(re.findall(r"\b(d[hr]d\w+)\(", SOURCE.read_text()))
    (folder / "fillers.h").write_text("".join(f"int {name}(void) {{ return -1; }}\n" for name in sorted(fillers)))
    flags = ["-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", f"-I{folder}"]
    subprocess.run([compiler, *flags, "-o", str(folder / "libdrd.so.3"), str(SOURCE), "-lm"], check=True)
    return folder / "libdrd.so.3"


@pytest.fixture
def sdk(built, tmp_path):
    """An SDK of its own for each test, in the folders the vendor's has."""
    folder = tmp_path / "lib" / "release" / f"lin-{platform.machine()}-gcc"
    folder.mkdir(parents=True)
    path = shutil.copy(built, folder / "libdrd.so.3.16.0")
    lib = ctypes.CDLL(str(path))
    lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
    forget_package()
    yield Sdk(tmp_path, lib)
    forget_package()
    assert lib.stub_wrongs().decode() == ""


pytestmark = needs_package


def test_order_of_use(sdk) -> None:
    device = sdk.opened()
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


@pytest.mark.parametrize(
    ("kind", "words"), [(-1, "does not say what it is"), (77, "does not say"), (81, "type 81, which is not known")]
)
def test_unknown_devices_are_refused(sdk, kind, words) -> None:
    sdk.lib.stub_type(0, kind)
    with pytest.raises(DeviceError, match=words):
        sdk.opened(keys="")


def test_model_that_is_not_stated_has_the_limits_of_the_weakest(sdk) -> None:
    device = sdk.opened(keys="")
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
        ("open", "is not to be had"),
        ("status", "its state cannot be read"),
        ("limit", "its force cannot be limited"),
        ("force", "its force cannot be set"),
        ("enable", "its forces cannot be enabled"),
        ("type", "does not say what it is"),
    ],
)
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


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_samples_and_forces_on_fewer_axes(sdk, axes) -> None:
    """The SDK's axes are the common ones."""
    device = sdk.opened(axes=axes)
    sdk.move(0, 0.01, -0.02, 0.03)
    sample = device.read(1)
    assert sample.position_m == (0.01, -0.02, 0.03)[:axes]
    assert (sample.velocity_mps, sample.age_ticks) == (None, device.capability.latency_ticks)
    device.write((0.5, 1.0, -1.5)[:axes])
    assert sdk.force() == (-0.5, -1.0, 1.5)[:axes] + (0.0,) * (3 - axes)
    with pytest.raises(DeviceError, match="read\\(tick=0\\) after tick 1; ticks must not fall"):
        device.read(0)
    device.close()
    assert sdk.force() == (0.0, 0.0, 0.0)


@given(force=st.tuples(*[st.floats(-100.0, 100.0)] * 3))
@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
def test_force_is_limited_and_keeps_its_direction(sdk, force) -> None:
    """The library fails the test at its end for a force above the limit that it was given."""
    device = sdk.opened()
    acting = device.write(force)
    assert tuple(-f for f in sdk.force()) == (acting or force)
    fraction = min(1.0, 12.0 / max(hypot(*force), 1e-300))
    assert sdk.force() == pytest.approx([-fraction * f for f in force], abs=1e-12)
    assert device.counts.get("force limited", 0) == (hypot(*force) > 12.0)
    device.close()


@pytest.mark.parametrize(
    "bad", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (0.0, 0.0, -inf), (1.7e308,) * 3, (1.0, 1.0), (1.0,) * 4]
)
def test_a_force_that_is_none_makes_it_zero(sdk, bad) -> None:
    device = sdk.opened()
    device.write((1.0, 1.0, 1.0))
    with pytest.raises(DeviceError, match="axes" if len(bad) != 3 else "not finite"):
        device.write(bad)
    assert sdk.force() == (0.0, 0.0, 0.0)
    device.write((0.0, 0.0, 1.0))
    assert sdk.force() == (0.0, 0.0, -1.0)
    device.close()


@pytest.mark.parametrize("bad", [(nan, 0.0, 0.0), (0.0, -inf, 0.0)])
def test_position_that_is_no_number_is_no_sample_and_no_force(sdk, bad) -> None:
    device = sdk.opened()
    device.write((1.0, 0.0, 0.0))
    sdk.move(0, *bad)
    assert device.read(1) is None
    assert sdk.force() == (0.0, 0.0, 0.0)
    device.write((1.0, 0.0, 0.0))
    assert sdk.force() == (0.0, 0.0, 0.0)
    assert device.counts == {"position not finite": 1}
    sdk.move(0, 0.01, 0.0, 0.0)
    assert device.read(2).position_m == (0.01, 0.0, 0.0)
    device.write((1.0, 0.0, 0.0))
    assert sdk.force() == (-1.0, 0.0, 0.0)
    device.close()


def test_what_the_controller_could_not_do_is_counted(sdk) -> None:
    sdk.lib.stub_fail(b"watchdog")
    device = sdk.opened()
    sdk.lib.stub_fail(b"")
    assert sdk.lib.stub_expert() == 0
    sdk.lib.stub_status(0, FORCE, 0)
    for tick in range(300):
        device.read(tick)
    sdk.lib.stub_status(0, FORCE, 1)
    sdk.lib.stub_guarded(0, 1)
    sdk.lib.stub_saturated(0, 1)
    assert device.read(300) is not None
    device.write((1.0, 0.0, 0.0))
    assert device.counts == {
        "watchdog not available": 1, "forces off": 2, "position read again too soon": 1, "motor saturated": 1
    }  # fmt: skip
    device.close()


@pytest.mark.parametrize("verb", ["position", "force", "status"])
def test_lost_device_says_so_and_has_no_force(sdk, verb) -> None:
    device, other = sdk.opened(), sdk.opened(1, keys="")
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


@pytest.mark.parametrize("verb", ["stop", "close"])
def test_close_never_raises(sdk, verb) -> None:
    device = sdk.opened()
    sdk.lib.stub_fail(verb.encode())
    device.close()
    assert device.counts == {"error at close": 1}
    assert sdk.force() == (0.0, 0.0, 0.0)


SCRIPT = """
import atexit, ctypes, sys
from cogrip.devices.forcedimension.family import family
from cogrip.devices.settings import parse_address
device = family().make(parse_address("forcedimension:0?model=omega3&sdk=" + sys.argv[1]), 3, {})
lib = ctypes.CDLL(sys.argv[2])
lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
atexit.register(lambda: print(lib.stub_journal().split(), lib.stub_wrongs()))  # runs last
device.open(1000)
device.write((1.0, 0.0, 0.0))
exec(sys.argv[3])
"""


@pytest.mark.parametrize("end", ["pass", "raise KeyboardInterrupt"])
def test_process_that_ends_without_closing(sdk, end) -> None:
    path = next(sdk.folder.rglob("libdrd.so.*"))
    command = [sys.executable, "-c", SCRIPT, str(sdk.folder), str(path), end]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.endswith("b'stop', b'0', b'close', b'0'] b''\n")


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_it_keeps_what_every_device_promises(sdk, check, axes) -> None:
    def acting(_) -> tuple[float, ...]:
        return tuple(-f for f in sdk.force()[:axes])

    check(Subject(lambda: sdk.device(0, axes), RATE_HZ, acting=acting))


@pytest.mark.parametrize("model", ["omega3", "delta3"])
@pytest.mark.parametrize("jump_m", [0.03, -0.03])
def test_a_jump_of_30_mm_is_no_kick(sdk, model, jump_m) -> None:
    """Before, a step of 24 N (omega.3) or 40 N (delta.3), from one limit to the other."""
    sdk.lib.stub_type(0, next(kind for kind, name in TYPES.items() if name == model))
    device = sdk.device(0, 1, f"&model={model}")
    client, forces = forces_over_a_jump(device, lambda x: sdk.move(0, x, 0.0, 0.0), jump_m)
    ends_softly(client, forces)


def test_sdk_that_is_too_old(sdk, capfd) -> None:
    """The package says so on the terminal; it stands in the error instead."""
    sdk.lib.stub_version(3, 15)
    with pytest.raises(DeviceError, match=r"cannot be loaded \(Invalid version. v3.15.*3.16.*sdk=FOLDER or in FDSDK"):
        sdk.opened()
    assert capfd.readouterr().err == ""


def test_sdk_that_is_not_there(monkeypatch) -> None:
    forget_package()
    monkeypatch.setenv("__fdsdkpy_unittest_runtime__", "True")  # it then finds none, wherever one may be installed
    with pytest.raises(DeviceError, match=r"the SDK cannot be loaded .*install the vendor's SDK, 3.16 or later"):
        make("forcedimension:0").open(RATE_HZ)
    forget_package()


def test_package_that_is_not_there(monkeypatch) -> None:
    forget_package()
    monkeypatch.setitem(sys.modules, PACKAGE, None)
    with pytest.raises(
        DeviceError, match=r"needs the package 'forcedimension_core.*pip install 'cogrip\[forcedimension\]'"
    ):
        make("forcedimension:0").open(RATE_HZ)


def test_another_sdk_than_the_one_loaded_is_refused(sdk, tmp_path) -> None:
    sdk.opened().close()
    with pytest.raises(DeviceError, match=r"sdk=.*other has no library, or .*libdrd.so.3.16.0 was loaded before"):
        make(f"forcedimension:0?sdk={tmp_path}/other").open(RATE_HZ)


def test_environment_is_left_as_it_was(sdk, monkeypatch) -> None:
    import os

    monkeypatch.setenv("FDSDK", "/elsewhere")
    sdk.opened().close()
    assert os.environ["FDSDK"] == "/elsewhere"


def test_types_are_those_of_the_package(sdk) -> None:
    sdk.opened().close()
    kinds = {int(kind): kind.name for kind in sys.modules[f"{PACKAGE}.constants"].DeviceType}
    for number, model in TYPES.items():
        assert kinds[number].replace("_RIGHT", "").replace("_LEFT", "").lower() == model
    assert set(TYPES.values()) == set(RECORDS)


@pytest.mark.parametrize(
    ("address", "axes", "words"),
    [
        ("forcedimension:", 3, "'' is no number from 0 to 15: write forcedimension:0"),
        ("forcedimension:16", 3, "'16' is no number from 0 to 15"),
        ("forcedimension:-1", 3, "'-1' is no number"),
        ("forcedimension:²", 3, "is no number"),
        ("forcedimension:0?modle=omega3", 3, "unknown key 'modle'; did you mean 'model'"),
        ("forcedimension:0?model=touch", 3, "model: expects one of falcon, omega3"),
        ("forcedimension:0?peak_force_n=-1", 3, "peak_force_n: expects a number"),
        ("forcedimension:0", 0, "axes=0 is out of 1 to 3"),
        ("forcedimension:0", 4, "axes=4 is out of 1 to 3"),
    ],
)
def test_addresses_that_are_wrong(address, axes, words) -> None:
    with pytest.raises(DeviceError, match=words):
        make(address, axes)


def test_peak_force_key_lowers_and_never_raises() -> None:
    assert make("forcedimension:0?model=omega3&peak_force_n=0.5").capability.continuous_force_n == 0.5
    assert make("forcedimension:0?model=omega3&peak_force_n=30").capability.peak_force_n == 12.0
