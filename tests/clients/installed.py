"""The client in C built and installed by its CMakeLists.txt, and programs that use it from there."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.clients.compiled import COMPILER, CXX, CXX_STRICT, SOURCES, WARNINGS, has_libssl

BUILT_S = 120.0
needs_cmake = pytest.mark.skipif(
    COMPILER is None or shutil.which("cmake") is None, reason="no CMake or no C compiler: install cmake and gcc"
)
needs_pkg_config = pytest.mark.skipif(shutil.which("pkg-config") is None, reason="no pkg-config: install pkgconf")
FINDS = """
cmake_minimum_required(VERSION 3.16)
project(consumer LANGUAGES {languages})
find_package(cogrip 0.1 REQUIRED)
add_executable(example {source})
target_link_libraries(example PRIVATE cogrip::cogrip {more})
target_compile_features(example PRIVATE {standard})
"""


def done(*command: object, folder: Path | None = None, **environment: str) -> str:
    """Run a command to its end. Returns what it says."""
    given = {**os.environ, **environment}
    ended = subprocess.run(
        list(map(str, command)), cwd=folder, env=given, capture_output=True, text=True, timeout=BUILT_S, check=False
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def install(folder: Path, *definitions: str) -> Path:
    """Build the library and install it below a folder, then move it. Returns the prefix: its files go by their own place."""
    first, prefix = folder / "first prefix", folder / "prefix"
    encrypted = "ON" if has_libssl() else "OFF"
    settings = ("-DCMAKE_BUILD_TYPE=", "-DCMAKE_C_FLAGS=-O1 -Werror", f"-DCOGRIP_DTLS={encrypted}", *definitions)
    done("cmake", "-S", SOURCES, "-B", folder / "build", f"-DCMAKE_INSTALL_PREFIX={first}", *settings)
    done("cmake", "--build", folder / "build")
    done("cmake", "--install", folder / "build")
    first.rename(prefix)
    return prefix


def compiled_by_pkg_config(folder: Path, prefix: Path, source: Path) -> Path:
    """Compile a program with what the pkg-config file of a prefix says."""
    found = os.pathsep.join(str(path.parent) for path in prefix.rglob("cogrip.pc"))
    static = () if list(prefix.rglob("libcogrip.so")) else ("--static",)
    flags = done("pkg-config", "--cflags", "--libs", *static, "cogrip", PKG_CONFIG_PATH=found).split()
    compiler = (COMPILER, *WARNINGS) if source.suffix == ".c" else (CXX, "-std=c++17", *CXX_STRICT)
    done(*compiler, "-O1", "-o", folder / "example", source, *flags, "-lm")
    return folder / "example"


def compiled_by_cmake(folder: Path, prefix: Path, source: Path) -> Path:
    """Compile a program by `find_package(cogrip)`."""
    c = source.suffix == ".c"
    text = FINDS.format(
        languages="C" if c else "CXX", source=source, standard="c_std_99" if c else "cxx_std_17", more="m" if c else ""
    )
    (folder / "CMakeLists.txt").write_text(text, encoding="utf-8")
    done("cmake", "-S", folder, "-B", folder / "build", f"-DCMAKE_PREFIX_PATH={prefix}")
    done("cmake", "--build", folder / "build")
    return folder / "build" / "example"


def library_folder(prefix: Path) -> Path:
    """Return the folder of the library of a prefix: on 64-bit systems not `lib` everywhere."""
    return next(path for path in prefix.rglob("libcogrip.*") if path.suffix in (".so", ".a")).parent
