"""The client in C as a shared library: its symbols, and programs that were compiled with an older or a newer header."""

import ctypes
import json
import re
import shutil
import subprocess
import tomllib
from ctypes import byref, c_char, create_string_buffer, sizeof
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.clients.abi import interface
from tests.clients.compiled import (
    CLIENT_BYTES,
    CXX,
    CXX_STRICT,
    HEADER,
    SOURCES,
    Config,
    Status,
    Target,
    build,
    has_libssl,
    load,
    needs_compiler,
    needs_cxx,
)
from tests.docs.pages import page

pytestmark = needs_compiler
ROOT = SOURCES.parents[1]
ABI = 0
KEPT = json.loads((Path(__file__).parent / f"abi_{ABI}.json").read_text(encoding="utf-8"))
"""The interface as programs of this ABI know it. What is added goes into the file; what stands in it stays."""
GIVEN = {"axes": 1, "rate_hz": 1024.0, "peak_force_n": 8.0, "speed_mps": 2.0}


@pytest.fixture(scope="module")
def shared(built: Path) -> Path:
    """Return the library as CMakeLists.txt compiles it."""
    encrypted = ["-lssl", "-lcrypto"] if has_libssl() else ["-DCOGRIP_NO_DTLS"]
    flags = ("-O1", "-fPIC", "-fvisibility=hidden", "-shared", "-DCOGRIP_SHARED")
    return build(built, "libcogrip.so", *flags, "cogrip.c", *encrypted)


@pytest.fixture(scope="module")
def linked(shared: Path) -> Any:
    return load(shared)


def init(linked: Any, config: Any, size: int) -> tuple[Any, str]:
    memory, error = create_string_buffer(CLIENT_BYTES), create_string_buffer(200)
    made = linked.cogrip_init(memory, CLIENT_BYTES, config, size, error, 200)
    return (memory, made), error.value.decode()


@pytest.mark.skipif(shutil.which("nm") is None, reason="no nm: install binutils")
def test_its_symbols_are_those_of_the_header_and_no_others(shared: Path) -> None:
    command = ["nm", "--dynamic", "--defined-only", "--format=posix", str(shared)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert {line.split()[0] for line in said.splitlines()} == set(interface()["functions"])


def test_what_a_program_of_this_abi_relies_on_stays_where_it_is() -> None:
    now = interface()
    assert now["memory"] == KEPT["memory"]
    for part in ("functions", "enums"):
        assert {name: now[part].get(name) for name in KEPT[part]} == KEPT[part]
    for name, fields in KEPT["structs"].items():
        held = {field: place for field, place in fields.items() if field}
        assert {field: now["structs"][name].get(field) for field in held} == held
        assert now["structs"][name][""] >= fields[""]
        added = [place for field, place in now["structs"][name].items() if field not in fields]
        assert all(place >= max(held.values()) for place in added), f"{name}: fields are added at its end alone"
    assert now == KEPT, "add what is new to the file, once it is to stay"


def test_structs_that_stand_in_others_or_are_given_without_a_size_cannot_grow() -> None:
    """cogrip_link_count stands in cogrip_status: what comes behind it would move."""
    assert interface()["structs"]["cogrip_link_count"] == KEPT["structs"]["cogrip_link_count"]
    by_pointer = re.findall(r"(cogrip_(?:config|status|target)) \*(\w+), (\w+ \w+)", HEADER)
    assert len(by_pointer) == 4
    assert all(size == f"size_t {name}_bytes" for _, name, size in by_pointer)


def test_the_version_is_that_of_the_project(linked: Any) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert linked.cogrip_version().decode() == project["version"]
    assert (linked.cogrip_abi(), linked.cogrip_client_bytes()) == (ABI, CLIENT_BYTES)
    assert linked.cogrip_driver_bytes() > CLIENT_BYTES


def test_a_program_with_an_older_config_gets_what_it_lacks_as_0(linked: Any) -> None:
    class Older(ctypes.Structure):
        _fields_ = Config._fields_[:-2]

    whole = Config(**GIVEN, damping_nspm=float("nan"), carried_nspm=float("nan"))  # behind the end of the older one
    assert init(linked, byref(whole), sizeof(whole))[1]
    kept, why = init(linked, byref(whole), sizeof(Older))
    assert kept[1], why


@pytest.mark.parametrize(("setting", "why"), [(0, ""), (7, "config: a setting that this library does not know yet")])
def test_a_program_with_a_newer_config_is_told_of_a_setting_that_is_not_known(
    linked: Any, setting: int, why: str
) -> None:
    class Newer(ctypes.Structure):
        _fields_ = [*Config._fields_, ("setting", ctypes.c_int)]

    kept, said = init(linked, byref(Newer(**GIVEN, setting=setting)), sizeof(Newer))
    assert bool(kept[1]) == (not why)
    assert said.startswith(why)


@pytest.mark.parametrize("kind", [Status, Target])
def test_no_more_of_a_struct_is_written_than_the_program_knows(linked: Any, kind: Any) -> None:
    """And what a newer program knows more is 0."""
    kept, _ = init(linked, byref(Config(**GIVEN)), sizeof(Config))
    whole = sizeof(kind)
    seen = []
    for size in (whole - 24, whole, whole + 24):
        into = (c_char * (whole + 48))(*b"\xaa" * (whole + 48))
        if kind is Status:
            linked.cogrip_get_status(kept[1], into, size)
        else:
            assert linked.cogrip_parse_target(b"[::1%2]:47800", into, size, None, 0)
        assert into.raw[size:] == b"\xaa" * (whole + 48 - size)
        seen.append(into.raw[:size])
    assert all(longer.startswith(shorter) for shorter, longer in pairwise(seen))
    assert seen[-1][whole:] == bytes(24)


PROGRAM = """
#include "cogrip.hpp"
cogrip::vector read_device();
void push_hand(const cogrip::vector &force_n);
void hold(const std::string &target);
void hold(const std::string &target) {
%s
}
"""
"""Lines around the block of C++ of docs/c_client.md."""


@needs_cxx
def test_the_program_of_the_page_compiles(tmp_path: Path) -> None:
    (block,) = re.findall(r"^```cpp\n(.*?)^```$", page("docs/c_client.md"), re.DOTALL | re.MULTILINE)
    (tmp_path / "page.cpp").write_text(PROGRAM % block, encoding="utf-8")
    command = [str(CXX), "-std=c++17", *CXX_STRICT, f"-I{SOURCES}", "-fsyntax-only", str(tmp_path / "page.cpp")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_it_sleeps_until_its_clock_shows_a_time(linked: Any) -> None:
    due_ns = linked.cogrip_now_ns() + 1_000_000
    assert linked.cogrip_sleep_until(due_ns) >= due_ns
    assert linked.cogrip_sleep_until(due_ns) >= due_ns  # at once, as it has passed
