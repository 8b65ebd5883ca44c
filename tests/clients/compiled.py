"""The client in C, compiled for a test and called from Python: no socket, no clock."""

import ctypes
import shutil
import subprocess
from collections.abc import Iterator
from ctypes import (
    POINTER,
    byref,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_size_t,
    c_uint32,
    c_void_p,
    create_string_buffer,
)
from functools import cache
from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent
SOURCES = HERE.parents[1] / "clients" / "c"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wconversion", "-Werror")
CHECKED = ("-g1", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
AXES, CLIENT_BYTES, MESSAGE_BYTES = 3, 409600, 1195
STATES = ("idle", "connecting", "seated", "resuming", "leaving", "closed")
SAFETY = ("released", "live", "stale", "fault")

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler: install gcc or clang")


@cache
def has_libssl() -> bool:
    found = subprocess.run(
        [str(COMPILER), "-E", "-x", "c", "-"],
        input="#include <openssl/ssl.h>\n",
        capture_output=True,
        text=True,
        check=False,
    )
    return COMPILER is not None and found.returncode == 0


def build(folder: Path, name: str, *arguments: str | Path) -> Path:
    """Compile C sources of the tests or the client, given by name, into a file. A warning fails."""
    sources = [
        str(next(place / each for place in (HERE, SOURCES) if (place / each).exists()))
        if str(each).endswith(".c")
        else str(each)
        for each in arguments
    ]
    out = folder / name
    done = subprocess.run(
        [str(COMPILER), *WARNINGS, f"-I{SOURCES}", "-o", str(out), *sources, "-lm"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return out


class Config(ctypes.Structure):
    _fields_ = (
        *((name, c_char_p) for name in ("room", "name", "token", "device", "software")),
        ("nonce", ctypes.c_uint64), ("axes", c_int),
        *((name, c_double) for name in (
            "rate_hz", "peak_force_n", "speed_mps", "slew_nps", "apparent_mass_kg", "damping_nspm", "carried_nspm")),
    )  # fmt: skip


class Count(ctypes.Structure):
    _fields_ = tuple(
        (name, c_int64) for name in ("sent", "received", "applied", "lost", "late", "duplicate", "pending")
    )


class Status(ctypes.Structure):
    _fields_ = (
        ("state", c_int), ("safety", c_int), ("axes", c_int), ("device_hz", c_int), ("network_hz", c_int), ("seat", c_int),
        ("tick", c_int64), ("impedance_nspm", c_double), ("rendered_npm", c_double),
        *((name, c_double * AXES) for name in ("position_m", "velocity_mps", "force_n", "object_m", "object_mps")),
        *((name, c_double) for name in (
            "rtt_ms", "playout_frames", "down_margin_j", "device_margin_j", "up_margin_j", "line_margin_j", "peak_force_n",
            "peak_step_n")),
        ("down", Count), ("room", ctypes.c_char * 161), ("user", ctypes.c_char * 161),
    )  # fmt: skip


class Target(ctypes.Structure):
    _fields_ = (
        ("host", ctypes.c_char * 300), ("room", ctypes.c_char * 41), ("token", ctypes.c_char * 33),
        ("fingerprint", ctypes.c_char * 65), ("port", c_int),
    )  # fmt: skip


def load(path: Path) -> Any:
    """Return the library of probe.c, its functions declared."""
    library = ctypes.CDLL(str(path))
    doubles, longs = POINTER(c_double), POINTER(c_int64)
    declared: dict[str, tuple[Any, list[Any]]] = {
        "cogrip_init": (c_void_p, [c_void_p, c_size_t, POINTER(Config), c_char_p, c_size_t]),
        "cogrip_connect": (None, [c_void_p, c_int64]),
        "cogrip_receive": (None, [c_void_p, c_char_p, c_size_t, c_int64]),
        "cogrip_poll": (None, [c_void_p, c_int64]),
        "cogrip_sense": (None, [c_void_p, c_int64, doubles, doubles, c_int64]),
        "cogrip_act": (None, [c_void_p, doubles, c_int64]),
        "cogrip_next": (c_size_t, [c_void_p, c_char_p, POINTER(c_int)]),
        "cogrip_handle": (None, [c_void_p, c_uint32, doubles, c_double]),
        "cogrip_leave": (None, [c_void_p, c_char_p, c_int64]),
        "cogrip_rearm": (None, [c_void_p]),
        "cogrip_done": (c_int, [c_void_p]),
        "cogrip_get_status": (None, [c_void_p, POINTER(Status)]),
        "cogrip_reason": (c_char_p, [c_void_p]),
        "cogrip_count": (ctypes.c_uint64, [c_void_p, c_int]),
        "cogrip_count_name": (c_char_p, [c_int]),
        "cogrip_parse_target": (c_int, [c_char_p, POINTER(Target), c_char_p, c_size_t]),
        "probe_decode": (c_int, [c_char_p, c_size_t]),
        "probe_fields": (None, [c_char_p, c_size_t]),
        "probe_heartbeat": (c_size_t, [c_int64, c_int64, c_char_p]),
        "probe_leave": (c_size_t, [c_int64, c_int, c_char_p]),
        "probe_client_bytes": (c_size_t, []),
        "probe_line": (None, [c_int, c_int, c_int, c_double, c_double, c_int]),
        "probe_push": (None, [c_double]),
        "probe_contents": (c_int, [longs, doubles, doubles, doubles]),
        "probe_take": (c_int, [c_int64, c_int, doubles, c_double, c_double, c_int64]),
        "probe_pop": (c_double, []),
        "probe_state": (None, [longs]),
        "probe_credit": (c_double, []),
        "probe_port_limit": (c_double, [c_double, c_double]),
        "probe_end_frame": (c_double, [c_double, c_int, c_int, c_double, doubles]),
        "probe_credit_of": (c_double, [c_void_p]),
        "probe_effects": (None, [c_int, doubles]),
        "probe_effects_tell": (c_int, [c_char_p, c_size_t, c_int64]),
        "probe_effects_know": (c_int, [c_int64]),
        "probe_effects_tick": (None, [c_int64, doubles, doubles, doubles, doubles, c_double, doubles, doubles]),
        "probe_effects_forget": (None, []),
    }
    for name, (result, arguments) in declared.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
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
        self._memory = create_string_buffer(CLIENT_BYTES)
        error = create_string_buffer(200)
        self._client = library.cogrip_init(self._memory, CLIENT_BYTES, byref(Config(**given)), error, 200)
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
        buffer, hello = create_string_buffer(MESSAGE_BYTES), c_int()
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
        self._library.cogrip_get_status(self._client, byref(status))
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
