"""One request and one reply a tick, and never a second request before the reply (devices that answer when asked).

The request of a tick carries its motor commands; the reply holds the encoders as they were when it came. The reply is read
at the next tick, when it has long been waiting, so the loop does not wait for the wire: a sample is one tick old, and the
force it leads to acts one tick after it was taken. That is all a blocking exchange would give too.

    asked --reply--> idle          asked --no reply for RETRY_S--> idle, whatever still comes is thrown away
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec

from cogrip.devices.device import DeviceError

RETRY_S = 0.005  # a request that is not answered for so long is made again
PATIENCE = 0.25  # share of a tick that a reply which is not there yet is waited for


class Reading(msgspec.Struct, frozen=True, gc=False):
    """One reply. raw: what the encoders say (counts, or degrees), one per joint; error: what the device complains of;

    rejected: it did not act upon the request, and what the encoders say is old.
    """

    raw: tuple[float, ...]
    error: str = ""
    rejected: bool = False
    model: str = ""
    gimbal: tuple[float, ...] = ()
    buttons: int = 0
    calibrate: bool = False  # the calibration button was pressed


class Port(Protocol):
    """Bytes (or whole reports) to and from a device. Making it opens nothing.

    Every verb raises DeviceError when the device is lost.
    """

    @property
    def name(self) -> str:
        """What a person calls it: a device node, a HID path."""
        ...

    def open(self) -> None: ...

    def write(self, frame: bytes) -> None:
        """The whole frame at once."""
        ...

    def read(self, wait_s: float = 0.0) -> bytes:
        """What has come, b"" for nothing; waits at most `wait_s` for the first of it."""
        ...

    def close(self) -> None:
        """Twice, or before opening, does nothing."""
        ...

    @property
    def counts(self) -> Mapping[str, int]:
        """What went wrong on the wire and was dealt with, by name."""
        ...

    def stamp(self) -> str:
        """Names this plugging-in of the device, and no other one; "" where that cannot be known."""
        ...


class Codec(Protocol):
    """A wire's frames. Pure; keeps the part of a frame that has come so far."""

    def encode(self, commands: Sequence[float]) -> bytes:
        """The request that applies these motor commands."""
        ...

    def load(self, counts: Sequence[float]) -> bytes | None:
        """The request that makes the device's counters these, with no current; None where the wire has none."""
        ...

    def feed(self, data: bytes) -> list[Reading]:
        """The replies that are complete, oldest first. What is no reply is skipped and counted, never raised."""
        ...

    def reset(self) -> None:
        """Forget a reply that is half there."""
        ...

    @property
    def skipped(self) -> int:
        """Bytes, or reports, that were no part of a good reply."""
        ...


class Exchange:
    """Requests and replies over a port, timed in ticks of the loop."""

    def __init__(self, port: Port, codec: Codec) -> None:
        self.port = port
        self.codec = codec
        self.counts: dict[str, int] = {}
        self._skipped = 0
        self.start(1024)

    def start(self, rate_hz: int) -> None:
        """No request is under way, and a tick is 1/rate_hz."""
        self._patience_s = PATIENCE / rate_hz
        self._retry_ticks = max(1, round(RETRY_S * rate_hz))
        self._asked: int | None = None
        self.codec.reset()

    def ask(self, commands: Sequence[float], tick: int) -> bool:
        """Send motor commands. False while a reply is outstanding: the commands in force stay, and this is counted."""
        if self._asked is not None:
            self._count("request held back")
            return False
        self.port.write(self.codec.encode(commands))
        self._asked = tick
        return True

    def reply(self, tick: int) -> tuple[Reading, int] | None:
        """The newest reply and its age in ticks, None if there is none."""
        asked = self._asked
        if asked is None:
            return None
        data = self.port.read(self._patience_s)
        readings = self.codec.feed(data)
        if data and not readings:  # a part of it: the rest is on its way
            self._count("reply in parts")
            readings = self.codec.feed(self.port.read(self._patience_s))
        if self.codec.skipped != self._skipped:
            self._count("bytes skipped", self.codec.skipped - self._skipped)
            self._skipped = self.codec.skipped
        if not readings:
            self._count("reply missed")
            if tick - asked >= self._retry_ticks:
                self._count("request repeated")
                self.codec.reset()
                self._asked = None
            return None
        if len(readings) > 1:
            self._count("reply too many", len(readings) - 1)
        self._asked = None
        return readings[-1], tick - asked

    def _count(self, name: str, by: int = 1) -> None:
        self.counts[name] = self.counts.get(name, 0) + by


def meet(exchange: Exchange, zero: Sequence[float], patience_s: float = 0.1, tries: int = 20) -> Reading:
    """The first good reply to requests for no force, and nothing left on the wire. Raises DeviceError after `tries` of them."""
    port, codec = exchange.port, exchange.codec
    codec.reset()
    while port.read():  # what was on its way before we came
        pass
    for _ in range(tries):
        port.write(codec.encode(zero))
        readings = codec.feed(port.read(patience_s))
        if readings:
            while port.read():  # replies to earlier tries
                pass
            codec.reset()
            return readings[-1]
    raise DeviceError(
        f"{port.name}: no reply to {tries} requests in {tries * patience_s:g} s; "
        "is this the right port, and is the device powered?"
    )
