"""Recordings to replay, made once: read them, do not spoil them. And the stub of libHD, one a test of `openhaptics:`."""

import ctypes
import shutil
from collections.abc import Iterator
from math import sin
from pathlib import Path
from typing import Any

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.devices.compiled_stub import STUBS, compile_stub
from tests.devices.forcedimension_bench import libdrd as libdrd
from tests.devices.forcedimension_bench import loadable as loadable
from tests.devices.forcedimension_bench import sdk as sdk
from tests.devices.openhaptics_bench import Bench
from tests.devices.replayed_hands import SECONDS


@pytest.fixture(scope="session")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people on two axes, one with encoders, one whose device gives velocities."""
    folder = tmp_path_factory.mktemp("run")
    table: dict[str, Any] = {
        "seconds": SECONDS,
        "object": {"axes": 2},
        "link": {"delay_ms": 10},
        "users": [
            {"name": "anna", "hand": "reach&direction=1,0.5"},
            {"name": "ben", "device": "sim:ideal", "hand": "tremor&amplitude_m=0.02&direction=1,-1&seed=4"},
        ],
    }
    run_laboratory(resolve(table), folder)
    return folder


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand every 1/256 s, in millimetres."""
    path = tmp_path_factory.mktemp("table") / "hand.csv"
    rows = [f"{k / 256},{10 * sin(k / 20) + 3},{k % 7}" for k in range(300)]
    path.write_text("\n".join(["t_s,x_mm,y_mm", *rows]) + "\n")
    return path


@pytest.fixture(scope="session")
def libhd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stand-in, compiled."""
    return compile_stub(STUBS / "libhd.c", tmp_path_factory.mktemp("openhaptics") / "libHD.so", "-Werror", "-lm")


@pytest.fixture
def servo(libhd: Path, tmp_path: Path) -> Iterator[Bench]:
    """A library of its own for each test, its servo's thread runs; whatever order of calls it finds wrong fails the test."""
    path = tmp_path / "libHD.so"
    shutil.copy(libhd, path)
    lib = ctypes.CDLL(str(path))
    lib.stub_journal.restype = lib.stub_wrongs.restype = ctypes.c_char_p
    lib.stub_worst.restype = ctypes.c_double
    lib.stub_frames.restype = lib.stub_torn.restype = ctypes.c_long
    lib.stub_wait.argtypes = [ctypes.c_long]
    yield Bench(lib, path)
    assert lib.stub_wrongs().decode() == ""
    assert lib.stub_running() == 0
    assert lib.stub_scheduled() == 0


@pytest.fixture
def bench(servo: Bench) -> Bench:
    """The same without a thread: the test runs the scheduler, round by round."""
    servo.lib.stub_manual(1)
    return servo
