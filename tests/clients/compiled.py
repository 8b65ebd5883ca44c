"""The client in C, compiled for a test and called from Python: no socket, no clock."""

import ctypes
import re
import shutil
import subprocess
from collections.abc import Iterator
from ctypes import POINTER, byref, c_char, c_char_p, c_double, c_int, c_void_p
from functools import cache
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
SOURCES = HERE.parents[1] / "clients" / "c"
HEADER, PROBE = (
    re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for path in (SOURCES / "cogrip.h", HERE / "probe.c")
)
NUMBERS = {
    name: getattr(ctypes, f"c_{name}".replace("64_t", "64").replace("32_t", "32"))
    for name in ("int", "double", "size_t", "int64_t", "uint32_t", "uint64_t")
}
KINDS = {**NUMBERS, "void": None, "char": c_char, "cogrip_state": c_int, "cogrip_safety": c_int}
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CXX = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror")
WARNINGS = ("-std=c99", *STRICT)
CXX_STRICT = ("-ffp-contract=off", *STRICT)
CXX_WARNINGS = ("-x", "c++", *CXX_STRICT)
CHECKED = ("-g1", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
AXES, CLIENT_BYTES, MESSAGE_BYTES = 3, 409600, 1195
STATES = ("idle", "connecting", "seated", "resuming", "leaving", "closed")
SAFETY = ("released", "live", "stale", "fault")

needs_cxx = pytest.mark.skipif(CXX is None, reason="no C++ compiler: install g++ or clang++")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler: install gcc or clang")


@cache
def has_libssl() -> bool:
    if COMPILER is None:
        return False
    command, source = [COMPILER, "-E", "-x", "c", "-"], b"#include <openssl/ssl.h>\n"
    found = subprocess.run(command, input=source, capture_output=True, check=False)
    return found.returncode == 0


def build(folder: Path, name: str, *arguments: str | Path, cxx: bool = False) -> Path:
    """Compile C sources of the tests or the client, given by name, into a file, as C99 or as C++. A warning fails."""
    sources = [
        str(next(place / each for place in (HERE, SOURCES) if (place / each).exists()))
        if isinstance(each, str) and each.endswith(".c")
        else str(each)
        for each in arguments
    ]
    out = folder / name
    compiler = [str(CXX), *CXX_WARNINGS] if cxx else [str(COMPILER), *WARNINGS]
    command = [*compiler, f"-I{SOURCES}", "-o", str(out), *sources, "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out


def kind_of(declared: str) -> Any:
    """Return the type of a result, an argument or a field. A pointer: to numbers, or to whatever it is given."""
    kind = re.sub(r"\b(COGRIP_API|static|const) ", "", declared).split()[0]
    if "*" not in declared:
        return KINDS[kind]
    return POINTER(KINDS[kind]) if kind in NUMBERS else c_void_p


def structure(name: str) -> Any:
    """Return a struct as the header has it."""
    body = re.search(rf"typedef struct {name} {{(.*?)}}", HEADER, re.DOTALL)
    assert body
    fields = []
    for line in body[1].split(";")[:-1]:
        for each in line.split(","):
            label, _, length = each.split()[-1].strip("*]").partition("[")
            kind = c_char_p if "*" in each else kind_of(line)
            fields.append((label, kind * int(length.replace("COGRIP_AXES", str(AXES))) if length else kind))
    return type(name, (ctypes.Structure,), {"_fields_": fields})


Config, Target = structure("cogrip_config"), structure("cogrip_target")
KINDS["cogrip_link_count"] = structure("cogrip_link_count")
Status = structure("cogrip_status")


def load(path: Path) -> Any:
    """Return the library of probe.c, its functions declared as the header and probe.c declare them."""
    library = ctypes.CDLL(str(path))
    prototype = r"^(\w[\w ]* \*?)((?:cogrip|probe)_\w+)\(([^)]*)\)"
    for result, name, arguments in re.findall(prototype, HEADER + PROBE, re.MULTILINE):
        if function := getattr(library, name, None):
            function.restype = c_char_p if "char" in result else kind_of(result)
            function.argtypes = [kind_of(each.strip()) for each in arguments.split(",") if each != "void"]
    return library


class CClient:
    """A client in C. `force_n` of the last tick; datagrams come from `sent`, as (bytes, whether it is a hello)."""

    def __init__(self, library: Any, **changes: Any) -> None:
        given = {
            "device": b"c:test", "software": b"test", "nonce": 42, "axes": 1, "rate_hz": 1024.0, "peak_force_n": 8.0,
            "speed_mps": 2.0,
            **changes,
        }  # fmt: skip
        self._library = library
        self._memory = ctypes.create_string_buffer(CLIENT_BYTES)
        error = ctypes.create_string_buffer(200)
        config = Config(**given)
        self._client = library.cogrip_init(self._memory, CLIENT_BYTES, byref(config), ctypes.sizeof(config), error, 200)
        if not self._client:
            raise ValueError(error.value.decode())
        self.force_n = (0.0,) * AXES

    def connect(self, now_ns: int) -> None:
        self._library.cogrip_connect(self._client, now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        self._library.cogrip_receive(self._client, datagram, len(datagram), now_ns)

    def poll(self, now_ns: int) -> None:
        self._library.cogrip_poll(self._client, now_ns)

    def sense(self, tick: int, position_m: tuple[float, ...] | None, now_ns: int) -> None:
        place = None if position_m is None else (c_double * AXES)(*position_m)
        self._library.cogrip_sense(self._client, tick, place, None, now_ns)

    def act(self, now_ns: int) -> tuple[float, ...]:
        force = (c_double * AXES)()
        self._library.cogrip_act(self._client, force, now_ns)
        self.force_n = tuple(force)
        return self.force_n

    def sent(self) -> Iterator[tuple[bytes, bool]]:
        buffer, hello = ctypes.create_string_buffer(MESSAGE_BYTES), c_int()
        while size := self._library.cogrip_next(self._client, buffer, byref(hello)):
            yield buffer.raw[:size], bool(hello.value)

    def handle(self, buttons: int, orientation: tuple[float, ...] | None = None, grip_m: float = float("nan")) -> None:
        turn = None if orientation is None else (c_double * 4)(*orientation)
        self._library.cogrip_handle(self._client, buttons, turn, grip_m)

    def leave(self, now_ns: int, reason: bytes = b"done") -> None:
        self._library.cogrip_leave(self._client, reason, now_ns)

    def rearm(self) -> None:
        self._library.cogrip_rearm(self._client)

    @property
    def done(self) -> bool:
        return bool(self._library.cogrip_done(self._client))

    @property
    def status(self) -> Status:
        status = Status()
        self._library.cogrip_get_status(self._client, byref(status), ctypes.sizeof(status))
        return status

    @property
    def state(self) -> str:
        return STATES[self.status.state]

    @property
    def safety(self) -> str:
        return SAFETY[self.status.safety]

    @property
    def credit_w(self) -> float:
        """Squares that the line down may give out beyond what came in [W]."""
        credit: float = self._library.probe_credit_of(self._client)
        return credit

    @property
    def reason(self) -> str:
        text: bytes = self._library.cogrip_reason(self._client)
        return text.decode()

    @property
    def counts(self) -> dict[str, int]:
        """Counts above 0, by name."""
        names = [self._library.cogrip_count_name(which).decode() for which in range(64)]
        counts = {name: self._library.cogrip_count(self._client, which) for which, name in enumerate(names) if name}
        return {name: count for name, count in counts.items() if count}
