"""CHAI3D's devices at a cogrip server, and a seat as a device of CHAI3D: live, beside a Python client.

Each test runs with a header of the interface that is written here; and with CHAI3D's own source, handler and drivers where the
variable CHAI3D_SOURCE names a checkout of version 3.3. Where CHAI3D_BUILD names a folder in which CMake has built it whole, a
scene with CHAI3D's tool and contact law runs, too.
"""

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import pytest

from cogrip.results.verdict.verdict import passive

from tests.clients.compiled import CHECKED, CXX, CXX_STRICT, build, has_libssl, needs_compiler, needs_cxx
from tests.clients.installed import done, install, needs_cmake
from tests.docs.pages import page
from tests.extent import long
from tests.live.test_live_sessions import DEMO, FEW_FRAMES, summary_in
from tests.stalls import MACHINE_STALLED

ROOT = Path(__file__).parents[2]
CLIENTS, HERE = ROOT / "clients", ROOT / "tests" / "clients"
SOURCE, WHOLE = (os.environ.get(name, "") for name in ("CHAI3D_SOURCE", "CHAI3D_BUILD"))
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
    ended = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False)
    assert ended.returncode == 0, ended.stderr


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
    ended = said(programs / "join", f"127.0.0.1:{port}", "--name", "anna", "--seconds", "1.5", ARM_FAILS="700")
    assert "device stall: 20 ms or more without samples" in ended.stderr
    assert "0.000 N at its end" in ended.stderr
    assert json.loads(ended.stdout)["peak_step_n"] <= SLEW_N


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
    ended = said(programs / "join", *arguments, **environment)
    lines = [line for line in ended.stderr.splitlines() if not line.startswith("arm: ")]
    assert (ended.returncode, ended.stdout, len(lines)) == (1, "", 1), ended.stderr
    assert why in lines[0]


def test_the_arms_are_listed(programs: Path) -> None:
    ended = said(programs / "join", "--list")
    assert (ended.returncode, ended.stdout) == (0, "0  tests simulated arm  8 N\n")


def test_an_application_of_chai3d_takes_part_by_a_seat(run, serve, tmp_path: Path, programs: Path) -> None:
    found, _ = beside_a_python_client(run, serve, tmp_path, programs / "application", SECONDS, "anna")
    assert (found["model"], found["refused"]) == ("seat", 0)
    assert found["frames"] > FEW_FRAMES
    assert 0.1 < found["applied_n"] <= 5.0
    assert found["room_n"] > 0.02
    assert FEW_FRAMES < found["loops"] <= found["ticks"] + 10  # setForce returns with the seat's next tick
    assert 0.0 < found["farthest_m"] < 0.2


SCENE = """
cmake_minimum_required(VERSION 3.16)
project(scene LANGUAGES CXX)
find_package(cogrip 0.1 REQUIRED)
find_package(chai3d 3.3 REQUIRED)
add_executable(scene {source})
target_compile_features(scene PRIVATE cxx_std_17)
target_compile_definitions(scene PRIVATE LINUX)
target_include_directories(scene PRIVATE {ours})
target_include_directories(scene SYSTEM PRIVATE ${{CHAI3D_INCLUDE_DIRS}})
target_link_directories(scene PRIVATE ${{CHAI3D_LIBRARY_DIRS}})
target_link_libraries(scene PRIVATE cogrip::cogrip ${{CHAI3D_LIBRARIES}} GLU GL)
"""


@needs_cmake
@pytest.mark.lasts(LONG_S)
@pytest.mark.skipif(
    not (Path(WHOLE) / "chai3dConfig.cmake").exists(),
    reason="no build of CHAI3D: set CHAI3D_BUILD to where CMake has built version 3.3",
)
def test_a_tool_of_chai3d_stays_at_its_wall_and_its_program_builds(run, serve, tmp_path: Path) -> None:
    where = f"-DCMAKE_PREFIX_PATH={install(tmp_path / 'library')};{WHOLE}"
    text = SCENE.format(source=HERE / "chai3d_scene.cpp", ours=CLIENTS / "chai3d")
    (tmp_path / "scene").mkdir()
    (tmp_path / "scene" / "CMakeLists.txt").write_text(text, encoding="utf-8")
    for name, source in (("scene", tmp_path / "scene"), ("join", CLIENTS / "chai3d")):
        done("cmake", "-S", source, "-B", tmp_path / f"{name} built", where)
        done("cmake", "--build", tmp_path / f"{name} built")
    listed = said(tmp_path / "join built" / "chai3d_join", "--list")
    assert (listed.returncode, listed.stderr) == (0, "")
    found, _ = beside_a_python_client(run, serve, tmp_path, tmp_path / "scene built" / "scene", SECONDS, "anna")
    assert found["chai3d"].startswith("3.3")
    assert found["touched"] > FEW_FRAMES
    assert 0.0 < found["deepest_m"] < 0.02
    assert found["device_margin_j"] >= 0.0


@pytest.mark.parametrize("mode", ["silent", "mad"])
def test_an_application_that_says_nothing_or_no_number_pushes_nobody(serve, programs: Path, mode: str) -> None:
    _, port = serve(DEMO, "--set", "link.delay_ms=0")
    ended = said(programs / "application", f"127.0.0.1:{port}", SECONDS, "anna", mode)
    assert ended.returncode == 0, ended.stderr
    found = json.loads(ended.stdout)
    assert found["applied_n"] > 0.1
    assert found["last_n"] == 0.0
    assert (found["refused"] > 0) == (mode == "mad")


def test_an_application_pushes_nobody_while_the_server_is_silent(serve, programs: Path) -> None:
    """Its force goes by the gain of the C client, and so with the room's."""
    server, port = serve(DEMO, "--set", "link.delay_ms=0")
    command = [programs / "application", f"127.0.0.1:{port}", "3.0", "anna"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as anna:
        server.hear("anna joined")
        server.signal(signal.SIGSTOP)
        output, errors = anna.communicate(timeout=LIMIT_S)
    server.signal(signal.SIGCONT)
    assert json.loads(output)["last_n"] == 0.0
    assert errors.count("\n") == 1, errors


def test_an_application_without_a_server_is_told_why(programs: Path) -> None:
    ended = said(programs / "application", "127.0.0.1:1", SECONDS, "anna")
    assert (ended.returncode, ended.stderr) == (1, "application: no server answered within 3 s\n")


def test_the_lines_of_the_page_compile(tmp_path: Path) -> None:
    (block,) = re.findall(r"^```cpp\n(.*?)^```$", page("docs/chai3d.md"), re.DOTALL | re.MULTILINE)
    text = '#include "seat_device.hpp"\nvoid hold(chai3d::cGenericHapticDevicePtr &hapticDevice);\n'
    text += f"void hold(chai3d::cGenericHapticDevicePtr &hapticDevice) {{\n{block}}}\n"
    (tmp_path / "page.cpp").write_text(text, encoding="utf-8")
    includes = [f"-I{CLIENTS / 'c'}", f"-I{CLIENTS / 'chai3d'}", f"-I{HERE / 'chai3d_interface'}"]
    compile_cxx(*includes, "-fsyntax-only", tmp_path / "page.cpp")


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
