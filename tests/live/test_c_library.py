"""The client in C installed as a library, and a program of each kind that found it there, beside a Python client."""

import json
import os
import re
import shutil
import signal
import subprocess
from pathlib import Path

import pytest

from cogrip.results.verdict.verdict import passive

from tests.clients.compiled import SOURCES, needs_cxx
from tests.clients.installed import (
    compiled_by_cmake,
    compiled_by_pkg_config,
    done,
    install,
    library_folder,
    needs_cmake,
    needs_pkg_config,
)  # fmt: skip
from tests.live.test_c_client import sealed
from tests.live.test_live_sessions import DEMO, FEW_FRAMES, summary_in
from tests.stalls import MACHINE_STALLED

pytestmark = needs_cmake

C, CPP = SOURCES / "example.c", SOURCES / "example.cpp"
SECONDS = "1.0"
BUILDERS = {"pkg-config": compiled_by_pkg_config, "CMake": compiled_by_cmake}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("library"))


def holds_a_cube_with_a_python_client(
    run, serve, folder: Path, program: Path, library: Path, encrypted: bool = False
) -> dict:
    """Hold the demo's cube with a program in the first seat and `cogrip join` in the second. Returns what the program says."""
    server, port = serve(DEMO, "--set", "link.delay_ms=0", *(sealed(folder) if encrypted else []))
    target = server.hear(r"(cogrip://[^' ]+)'")[1] if encrypted else f"127.0.0.1:{port}"
    ben = run("join", target, "--name", "ben", "--seconds", SECONDS, "--runs", str(folder / "ben"), "--no-report")
    anna = subprocess.run(
        [program, "-", SECONDS, "anna"], input=target, capture_output=True, text=True, timeout=60, check=False,
        env={**os.environ, "LD_LIBRARY_PATH": str(library)},
    )  # fmt: skip
    if "watchdog" in anna.stderr:
        pytest.skip(f"{MACHINE_STALLED} from a loop for 100 ms: no live session can be judged on it now")
    assert anna.returncode == 0, anna.stderr
    assert ben.end() == 0, ben.said
    server.signal(signal.SIGTERM)
    server.end()
    whole = summary_in(folder / "server")
    assert passive(whole).tone == "good", passive(whole)
    assert [user["name"] for user in whole["users"]] == ["anna", "ben"]
    for user in whole["users"]:
        assert user["state"] == "idle"
        assert user["link"]["applied"] > FEW_FRAMES
        assert user["energy"]["device_margin_j"] >= 0.0
    said: dict = json.loads(anna.stdout)
    assert said["frames"] > FEW_FRAMES
    assert said["device_margin_j"] >= 0.0
    return said


@pytest.mark.parametrize(("source", "by"), [
    pytest.param(C, "pkg-config", marks=needs_pkg_config),
    pytest.param(CPP, "CMake", marks=needs_cxx),
    pytest.param(C, "CMake", marks=pytest.mark.long),
    pytest.param(CPP, "pkg-config", marks=[needs_cxx, needs_pkg_config, pytest.mark.long]),
])  # fmt: skip
def test_a_program_that_found_the_library_holds_a_cube_with_a_python_client(
    run, serve, tmp_path: Path, prefix: Path, source: Path, by: str
) -> None:
    program = BUILDERS[by](tmp_path, prefix, source)
    if shutil.which("readelf"):
        needed = re.findall(r"NEEDED.*\[(libcogrip.*)\]", done("readelf", "--dynamic", program))
        assert needed == ["libcogrip.so.0"]
    holds_a_cube_with_a_python_client(run, serve, tmp_path, program, library_folder(prefix))


@pytest.mark.long
@pytest.mark.parametrize("by", ["CMake", "pkg-config"])
def test_a_program_can_have_the_library_within_itself(tmp_path: Path, by: str) -> None:
    """By `-DBUILD_SHARED_LIBS=OFF`: it then needs no libcogrip to run, and links what that needs."""
    if by == "pkg-config" and shutil.which("pkg-config") is None:
        pytest.skip("no pkg-config: install pkgconf")
    static = install(tmp_path, "-DBUILD_SHARED_LIBS=OFF")
    (tmp_path / "program").mkdir()
    program = BUILDERS[by](tmp_path / "program", static, C)
    ended = subprocess.run([program, "[::1"], capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 1
    assert "as [ADDRESS]:PORT" in ended.stderr


@needs_cxx
@needs_pkg_config
def test_the_header_for_cxx_throws_one_line_and_needs_no_other_header(tmp_path: Path, prefix: Path) -> None:
    source = tmp_path / "wrong.cpp"
    source.write_text("""
        #include <cogrip.hpp>
        #include <cstdio>
        #include <type_traits>
        static_assert(!std::is_copy_constructible<cogrip::seat>::value, "one seat, one owner");
        int main(int count, char **texts) {
            cogrip::options given;
            given.peak_force_n = 8.0;
            given.speed_mps = count > 2 ? 2.0 : 0.0;
            try {
                cogrip::seat first(texts[1], given), second(std::move(first));
                first = std::move(second);
                first.wait_until_seated();
            } catch (const cogrip::error &wrong) {
                std::puts(wrong.what());
                return 1;
            }
            return 0;
        }
    """)
    program = compiled_by_pkg_config(tmp_path, prefix, source)
    environment = {**os.environ, "LD_LIBRARY_PATH": str(library_folder(prefix))}
    for arguments, why in [
        (["127.0.0.1:1"], "speed_mps: above 0, below 10^6\n"),
        (["[::1", "fast"], "as [ADDRESS]:PORT"),
        (["127.0.0.1:1", "fast"], "no server answered within 3 s\n"),
    ]:
        ended = subprocess.run(
            [program, *arguments], env=environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert (ended.returncode, ended.stdout.count("\n")) == (1, 1), ended.stderr
        assert why in ended.stdout
