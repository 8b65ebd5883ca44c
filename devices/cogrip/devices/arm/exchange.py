"""One request and one reply a tick, and never a second request before the reply (devices that answer when asked).

The request of a tick carries its motor commands; the reply holds the encoders as they were when it came. The reply is read
at the next tick, when it has long been waiting, so the loop does not wait for the wire: a sample is one tick old, and the
force it leads to acts one tick after it was taken. That is all a blocking exchange would give too.

    asked --reply--> idle        asked --no reply for RETRY_S--> asked again --all replies, or no more for RETRY_S--> idle
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Protocol

import msgspec

from cogrip.devices.device import DeviceError

RETRY_S = 0.005  # a request that is not answered for so long is made again
MOST_DRAINED = 1000  # Most reads that drain a line. A device that only answers has nothing more to say long before.
PATIENCE = 0.25  # share of a tick for which a reply that is not there yet is waited for


class Reading(msgspec.Struct, frozen=True, gc=False):
    """One reply. raw: what the encoders say (counts, or degrees), one per joint; error: what the device complains of;

    rejected: it did not act upon the request, and what the encoders say is old. gimbal: counts d, e, f of the handle, empty
    where there is none, or it cannot be read; buttons: bit k, button k + 1 is down.
    """

    raw: tuple[float, ...]
    error: str = ""
    rejected: bool = False
    model: str = ""
    gimbal: tuple[float, ...] = ()
    buttons: int = 0


class ByteLine(Protocol):
    """Bytes (or whole reports) to and from a device. Making it opens nothing.

    Every verb raises DeviceError when the device is lost.
    """

    @property
    def name(self) -> str:
        """Name for people: a device node, a HID path."""

    def open(self) -> None: ...

    def write(self, frame: bytes) -> None:
        """The whole frame at once."""

    def read(self, wait_s: float = 0.0) -> bytes:
        """Return the bytes received, b"" for none; wait at most `wait_s` for the first one."""

    def close(self) -> None:
        """Twice, or before opening, does nothing."""

    @property
    def counts(self) -> Mapping[str, int]:
        """Errors on the wire that were handled, counted by name."""

    def stamp(self) -> str:
        """Names this plugging-in of the device, and no other one; "" where that cannot be known."""


class Codec(Protocol):
    """A wire's frames. Pure; keeps the part of a frame that has come so far."""

    def encode(self, commands: Sequence[float]) -> bytes:
        """The request that applies these motor commands."""

    def load(self, counts: Sequence[float]) -> bytes | None:
        """The request that makes the device's counters these, with no current; None where the wire has none.

        counts: of the joints a, b, c, then of the gimbal's d, e, f.
        """

    def feed(self, data: bytes) -> list[Reading]:
        """The replies that are complete, oldest first. What is no reply is skipped and counted, never raised."""

    def reset(self) -> None:
        """Forget a reply that is half there."""

    @property
    def skipped(self) -> int:
        """Bytes, or reports, that were no part of a good reply."""


class RequestExchange:
    """Requests and replies over a line, timed in ticks of the loop."""

    def __init__(self, line: ByteLine, codec: Codec) -> None:
        self.line = line
        self.codec = codec
        self.counts: Counter[str] = Counter()
        self._skipped = 0
        self.start(1024)

    def start(self, rate_hz: int) -> None:
        """No request is under way, and a tick is 1/rate_hz."""
        self._patience_s = PATIENCE / rate_hz
        self._retry_ticks = max(1, round(RETRY_S * rate_hz))
        self._asked: int | None = None  # the tick of the last request, while another one must wait
        self._pushes = False  # what was asked for last is more than nothing
        self._given_up = 0  # requests before it whose replies may still come
        self._kept: Reading | None = None  # a reply that may be theirs
        self._since = 0  # nothing has come or gone
        self.codec.reset()

    def ask(self, commands: Sequence[float], tick: int) -> bool:
        """Send motor commands. False while a reply is outstanding: the commands in force stay, and this is counted.

        To let go is told all the same, once the last request has had its time.
        """
        if self._asked is not None:
            lets_go = self._pushes and not any(commands)
            if not lets_go or tick - self._asked < self._retry_ticks:
                self.counts["request held back"] += 1
                return False
            self._given_up += 1
        self._pushes = any(commands)
        self.line.write(self.codec.encode(commands))
        self._asked = self._since = tick
        return True

    def reply(self, tick: int) -> tuple[Reading, int] | None:
        """The newest reply and its age in ticks, None if there is none.

        After a request was repeated nobody can tell whose reply comes first. Then it is kept until the others are there too, or
        have not come for RETRY_S: a reply taken for the next one would leave the driver behind by one for ever.
        """
        asked = self._asked
        if asked is None:
            return None
        readings = self._read()
        received = len(readings)
        if received > 1:
            self.counts["reply too many"] += received - 1
        if received > self._given_up:
            return self._answered(readings[-1], tick - asked)
        if received:
            self._given_up -= received
            self._kept, self._since = readings[-1], tick
            return None
        self.counts["reply late"] += 1
        if tick - self._since >= self._retry_ticks:
            self.codec.reset()
            if self._kept is not None:
                return self._answered(self._kept, tick - asked)
            self.counts["reply missed"] += 1
            self._given_up += 1
            self._asked = None
        return None

    def _read(self) -> list[Reading]:
        data = self.line.read(self._patience_s)
        readings = self.codec.feed(data)
        if data and not readings:  # a part of it: the rest is on its way
            self.counts["reply in parts"] += 1
            readings = self.codec.feed(self.line.read(self._patience_s))
        if self.codec.skipped != self._skipped:
            self.counts["bytes skipped"] += self.codec.skipped - self._skipped
            self._skipped = self.codec.skipped
        return readings

    def _answered(self, reading: Reading, age: int) -> tuple[Reading, int]:
        self._given_up = 0
        self._asked = self._kept = None
        return reading, age


def meet(exchange: RequestExchange, zero: Sequence[float], patience_s: float = 0.1, tries: int = 10) -> Reading:
    """The first good reply to requests for no force, and nothing left on the wire. Raises DeviceError after `tries` of them."""
    line, codec = exchange.line, exchange.codec
    _drain(line)  # what was on its way before we came
    codec.reset()
    complaint = ""
    for _ in range(tries):
        line.write(codec.encode(zero))
        readings = codec.feed(line.read(patience_s))
        good = [reading for reading in readings if not reading.rejected]
        if good:
            _drain(line)  # replies to earlier tries
            codec.reset()
            return good[-1]
        if readings:  # half a request stood before ours, and its counts are old
            complaint = readings[-1].error
    if complaint:
        raise DeviceError(f"{line.name}: refuses every request: {complaint}; is it the right device? Power it up anew")
    took = f"no reply to {tries} requests in {tries * patience_s:g} s"
    raise DeviceError(f"{line.name}: {took}; is this the right port, and is the device powered?")


def _drain(line: ByteLine) -> None:
    for _ in range(MOST_DRAINED):
        if not line.read():
            return
    raise DeviceError(f"{line.name}: sends without being asked, so it is another device; is this the right port?")
