"""Hands to be replayed: recordings as they are made, read back, and played."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from cogrip.client.recorder import client_topics, start_text
from cogrip.devices import make
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Tick, kind_of
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.wire.session import make_hello

from tests.devices.held_device import RATE_HZ, hold, opened
from tests.recording_files import written

SECONDS = 1.5
TICKS = round(SECONDS * RATE_HZ)
Numbers = np.ndarray[Any, np.dtype[np.float64]]
Place = Sequence[float] | None


def replays(run: Path, table: Path) -> tuple[str, str, str]:
    """Addresses of two axes: a person of a run, one at another speed and over and over, and one of a table."""
    return (
        f"replay:{run}#user=ben",
        f"replay:{run}#user=anna&speed=0.3&loop=1&start_s=0.2",
        f"replay:{table}#time=t_s&x=x_mm&y=y_mm&scale=0.001",
    )


def write_recording(
    path: Path, places: Sequence[tuple[int, Place]], address: str = "sim:phantom", axes: int = 1, name: str = "anna"
) -> None:
    """A client's recording of these (tick, position), None where there was no sample; its velocity is the tick's number."""
    rows = []
    for tick, place in places:
        row = (float(tick),) * (len(place) if place else axes)
        rows.append((tick, place, row, row))
    write_rows(path, rows, address, axes, name)


def write_rows(
    path: Path, rows: Sequence[tuple[int, Place, Place, Place]], address: str, axes: int = 1, name: str = "anna", **keys: float
) -> None:  # fmt: skip
    """A client's recording of these (tick, position, velocity, force)."""
    device = make(address, axes=axes, **keys)
    hello = make_hello(software="x", nonce=1, room="r", name=name, digest="", device=address, axes=axes, rate_hz=1e3)
    start = start_text(hello, device.capability)
    header = Header("client", name, start, RATE_HZ, 1, 0, True, versions_here(), client_topics(name))
    with written(path, header) as writer:
        for tick, place, velocity, force in rows:
            zero = (0.0,) * len(force)
            record = Tick(tick, 0, 0, tuple(place) if place else None, velocity, force, 0.0, 0.0, (), (), zero)
            writer.put(0, due_ns(0, tick, RATE_HZ), encode(record))


def recorded(path: Path) -> tuple[Numbers, Numbers]:
    """Position and velocity of every tick as the file holds them, read by nothing under test."""
    recording = open_recording(path)
    ticks = [
        msgspec.json.decode(message.payload, type=Tick)
        for message in recording.messages()
        if kind_of(recording.topics[message.topic]) == "tick"
    ]
    return np.array([tick.position_m for tick in ticks]), np.array([tick.velocity_mps for tick in ticks])


def played(address: str, ticks: int, axes: int = 1, rate_hz: int = RATE_HZ) -> Numbers:
    """Positions of so many ticks, shape (ticks, axes)."""
    samples = hold(opened(address, axes, rate_hz), ticks, (0.5,) * axes)
    return np.array([sample.position_m for sample in samples])
