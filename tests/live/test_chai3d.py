"""CHAI3D's devices at a cogrip server, and a seat as a device of CHAI3D: live, beside a Python client.

Each test runs with a header of the interface that is written here; and with CHAI3D's own source, handler and drivers where the
variable CHAI3D_SOURCE names a checkout of version 3.3.
"""

import json
import os
import signal
import subprocess
from pathlib import Path

import pytest

from cogrip.results.verdict.verdict import passive

from tests.clients.compiled import CHECKED, CXX, CXX_STRICT, build, has_libssl, needs_compiler, needs_cxx
from tests.extent import long
from tests.live.test_live_sessions import DEMO, FEW_FRAMES, summary_in
from tests.stalls import MACHINE_STALLED

ROOT = Path(__file__).parents[2]
CLIENTS, HERE = ROOT / "clients", ROOT / "tests" / "clients"
SOURCE = os.environ.get("CHAI3D_SOURCE", "")
OF_CHAI3D = (
    "devices/CHapticDeviceHandler", "devices/CGenericHapticDevice", "devices/CGenericDevice", "devices/CDeltaDevices",
    "devices/CLeapDevices", "devices/CPhantomDevices", "system/CGlobals", "system/CMutex", "system/CThread",
    "timers/CPrecisionClock",
)  # fmt: skip
"""Files of CHAI3D's `src` that know of devices; its scenes and screens are of no concern here."""
SECONDS = "2.0"
SLEW_N = 1000.0 / 1024 * (1.0 + 1e-6)  # the steepest force, in a tick
LIMIT_S = 60.0
LONG_S = 300.0

pytestmark = [needs_cxx, needs_compiler]


def compile_cxx(*arguments: object, strict: bool = True, limit_s: float = LIMIT_S) -> None:
    warnings = CXX_STRICT if strict else ("-w",)
    command = [str(CXX), "-std=c++17", "-O1", *warnings, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)
    assert done.returncode == 0, done.stderr


def link_flags(folder: Path) -> list[str]:
    return [f"-L{folder}", f"-Wl,-rpath,{folder}", "-lcogrip", "-lpthread"]


def with_our_header(folder: Path) -> tuple[list[str], list[str]]:
    """Return what compiles against the header that is written here, with the sanitizers, and what links."""
    return [f"-I{HERE / 'chai3d_interface'}", *CHECKED], []


def with_chai3d(folder: Path) -> tuple[list[str], list[str]]:
    """Compile what CHAI3D has of devices. Returns what compiles against it, and what links: Force Dimension's library, too."""
    source = Path(SOURCE)
    includes = [
        f"{source}/{each}" for each in ("src", "externals/Eigen", "externals/glew/include", "externals/DHD/include")
    ]
    flags = ["-DLINUX", *(f"-isystem{each}" for each in includes)]
    objects = [folder / f"{Path(each).name}.o" for each in OF_CHAI3D]
    for each, made in zip(OF_CHAI3D, objects, strict=True):
        compile_cxx(*flags, "-c", source / "src" / f"{each}.cpp", "-o", made, strict=False)
    drd = source / "externals/DHD/lib" / f"lin-{os.uname().machine}" / "libdrd.a"
    return flags, [*map(str, objects), str(drd), "-lusb-1.0", "-ldl", "-lrt"]


needs_source = pytest.mark.skipif(
    not (Path(SOURCE) / "src/devices/CHapticDeviceHandler.cpp").exists(),
    reason="no source of CHAI3D: set CHAI3D_SOURCE to a checkout of version 3.3 (and install libusb-1.0-0-dev)",
)
VARIANTS = [
    pytest.param(with_our_header, id="our header"),
    pytest.param(with_chai3d, id="CHAI3D", marks=[needs_source, pytest.mark.lasts(LONG_S)]),
]


@pytest.fixture(scope="module", params=VARIANTS)
def programs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the programs `join` and `application`."""
    folder = tmp_path_factory.mktemp("chai3d")
    encrypted = ["-lssl", "-lcrypto"] if has_libssl() else ["-DCOGRIP_NO_DTLS"]
    shared = ("-O1", "-fPIC", "-fvisibility=hidden", "-shared", "-DCOGRIP_SHARED")
    build(folder, "libcogrip.so", *shared, "cogrip.c", *encrypted)
    flags, linked = request.param(folder)
    ours = [f"-I{CLIENTS / 'c'}", f"-I{CLIENTS / 'chai3d'}", *flags]
    arm = folder / "arm.o"
    compile_cxx(*ours, "-c", HERE / "simulated_arm.cpp", "-o", arm)
    for name, source in (("join", CLIENTS / "chai3d/join.cpp"), ("application", HERE / "chai3d_application.cpp")):
        compile_cxx(*ours, source, arm, *linked, *link_flags(folder), "-o", folder / name)
    return folder


def said(program: Path, *arguments: str, given: str = "", **environment: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [program, *arguments], input=given, env={**os.environ, **environment}, capture_output=True, text=True,
        timeout=LIMIT_S, check=False,
    )  # fmt: skip


def beside_a_python_client(run, serve, folder: Path, program: Path, *arguments: str) -> tuple[dict, str]:
    """Hold the demo's cube with a program in the first seat. Returns what it says, and what it says of errors."""
    server, port = serve(DEMO, "--set", "link.delay_ms=0")
    target = f"127.0.0.1:{port}"
    ben = run("join", target, "--name", "ben", "--seconds", SECONDS, "--runs", str(folder / "ben"), "--no-report")
    anna = said(program, target, *arguments)
    if "watchdog" in anna.stderr:
        pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
    assert anna.returncode == 0, anna.stderr
    assert ben.end() == 0, ben.said
    server.signal(signal.SIGTERM)
    server.end()
    whole = summary_in(folder / "server")
    assert passive(whole).tone == "good", passive(whole)
    for user in whole["users"]:
        assert user["state"] == "idle"
        assert user["link"]["applied"] > FEW_FRAMES
        assert user["energy"]["device_margin_j"] >= 0.0
    return json.loads(anna.stdout), anna.stderr


def test_an_arm_of_chai3d_holds_a_cube_with_a_python_client(run, serve, tmp_path: Path, programs: Path) -> None:
    found, errors = beside_a_python_client(
        run, serve, tmp_path, programs / "join", "--name", "anna", "--seconds", SECONDS
    )
    assert "anna holds the object by simulated arm" in errors
    assert "0.000 N at its end" in errors
    assert found["frames"] > FEW_FRAMES
    assert found["absent_samples"] == 0
    assert 0.02 < found["peak_force_n"] <= 3.0 * (1.0 + 1e-9)  # of an arm of 8 N no more than 3 by itself
    assert found["peak_step_n"] <= SLEW_N


def test_an_arm_that_gives_no_place_any_more_ends_without_force(serve, programs: Path) -> None:
    _, port = serve(DEMO, "--set", "link.delay_ms=0")
    done = said(programs / "join", f"127.0.0.1:{port}", "--name", "anna", "--seconds", "1.5", ARM_FAILS="700")
    assert "device stall: 20 ms or more without samples" in done.stderr
    assert "0.000 N at its end" in done.stderr
    assert json.loads(done.stdout)["peak_step_n"] <= SLEW_N


@pytest.mark.parametrize(("arguments", "environment", "why"), [
    long(["127.0.0.1:1"], {}, "no server answered within 3 s"),
    (["127.0.0.1:1", "--device", "7"], {}, "--device 7: CHAI3D finds 1 devices"),
    (["127.0.0.1:1", "--peak-n", "9"], {}, "simulated arm gives 8.000000 N at most"),
    (["127.0.0.1:1", "--seconds", "soon"], {}, "--seconds soon: give a number of 0 or more"),
    (["127.0.0.1:1", "--fast", "1"], {}, "--fast: no such flag"),
    ([], {}, "no target: give a join link"),
    (["127.0.0.1:1"], {"ARM_MODEL": "tracker"}, "tracker: it senses no place or has no motors"),
])  # fmt: skip
def test_a_seat_that_cannot_be_had_says_why_in_one_line(
    programs: Path, arguments: list, environment: dict, why: str
) -> None:
    done = said(programs / "join", *arguments, **environment)
    lines = [line for line in done.stderr.splitlines() if not line.startswith("arm: ")]
    assert (done.returncode, done.stdout, len(lines)) == (1, "", 1), done.stderr
    assert why in lines[0]


def test_the_arms_are_listed(programs: Path) -> None:
    done = said(programs / "join", "--list")
    assert (done.returncode, done.stdout) == (0, "0  tests simulated arm  8 N\n")


def test_an_application_of_chai3d_takes_part_by_a_seat(run, serve, tmp_path: Path, programs: Path) -> None:
    found, _ = beside_a_python_client(run, serve, tmp_path, programs / "application", SECONDS, "anna")
    assert (found["model"], found["refused"]) == ("seat", 0)
    assert found["frames"] > FEW_FRAMES
    assert 0.1 < found["applied_n"] <= 5.0
    assert found["room_n"] > 0.02
    assert 0.0 < found["farthest_m"] < 0.2


@pytest.mark.parametrize("mode", ["silent", "mad"])
def test_an_application_that_says_nothing_or_no_number_pushes_nobody(serve, programs: Path, mode: str) -> None:
    _, port = serve(DEMO, "--set", "link.delay_ms=0")
    done = said(programs / "application", f"127.0.0.1:{port}", SECONDS, "anna", mode)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["applied_n"] > 0.1
    assert found["last_n"] == 0.0
    assert (found["refused"] > 0) == (mode == "mad")


def test_an_application_without_a_server_is_told_why(programs: Path) -> None:
    done = said(programs / "application", "127.0.0.1:1", SECONDS, "anna")
    assert (done.returncode, done.stderr) == (1, "application: no server answered within 3 s\n")


@pytest.fixture(scope="module")
def handle(tmp_path_factory: pytest.TempPathFactory) -> dict[str, float]:
    """Return what handle_probe.cpp finds of the simulated handle, in virtual time."""
    program = tmp_path_factory.mktemp("handle") / "probe"
    compile_cxx(f"-I{CLIENTS / 'c'}", f"-I{CLIENTS / 'chai3d'}", HERE / "handle_probe.cpp", "-o", program)
    lines = subprocess.run([program], capture_output=True, text=True, timeout=LIMIT_S, check=True).stdout.splitlines()
    return {name: float(number) for name, number in (line.split() for line in lines)}


def test_what_the_handle_claims_to_render_is_at_rest_and_far_more_is_not(handle: dict[str, float]) -> None:
    assert (handle["stiffness_npm"], handle["carried_nspm"]) == pytest.approx((600.0, 26.667), rel=1e-3)
    assert max(handle["stiff_mps"], handle["damped_mps"], handle["both_mps"]) < 1e-4
    assert min(handle["too_stiff_mps"], handle["too_damped_mps"]) > 0.1


def test_an_applications_force_has_limits_and_goes_with_the_gain(handle: dict[str, float]) -> None:
    for name in ("strong", "weak", "half", "none", "mad", "infinite"):
        assert handle[f"{name}_steepest_n"] <= SLEW_N
        assert handle[f"{name}_largest_n"] <= 5.0 * (1.0 + 1e-9)
        assert handle[f"{name}_after_n"] == 0.0  # 0.15 s after it said anything
        assert handle[f"{name}_speed_mps"] <= 0.8
    assert handle["strong_largest_n"] == pytest.approx(5.0)
    assert handle["half_largest_n"] == pytest.approx(0.5 * handle["weak_largest_n"])
    assert handle["none_largest_n"] == handle["mad_largest_n"] == handle["infinite_largest_n"] == 0.0
    assert [handle[f"{name}_taken"] for name in ("weak", "mad", "infinite")] == [1, 0, 0]


def test_a_positive_force_of_the_line_pushes_the_handle_back(handle: dict[str, float]) -> None:
    """It resists motion in +x; so one of -1 N pushes toward +x, against the drag alone."""
    assert handle["pushed_m"] == pytest.approx(1.0 / 3.0 - 0.2 / 9.0, rel=0.01)
