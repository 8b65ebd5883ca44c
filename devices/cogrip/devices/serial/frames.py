"""The bracket-ASCII frames of hfab firmware 2.

request  `[a,b,c]\\n`, motor currents in mA, filled up with NUL to 16 bytes
reply    `[model,e0,e1,e2,e3,e4,e5,error]\\n`: which machine, counts of the three joints, of the three gimbal axes, error bits
"""

import re
from collections.abc import Sequence

from cogrip.devices.arm.exchange import Reading

MODELS = {1: "polhem", 2: "vintage", 3: "woodenhaptics-serial"}
ERRORS = {
    1: "gimbal sensor d cannot be read",
    2: "gimbal sensor e cannot be read",
    4: "gimbal sensor f cannot be read",
    8: "stray characters after a frame",
    128: "no end of frame within 127 bytes",
    256: "end of frame before its start",
    512: "not two commas",
    1024: "not three integers",
}
REJECTED = 8  # first error code that says that the request was not acted upon, and that the counts are old
SHORTEST_REQUEST = 16
LONGEST_REPLY = 128

_NUMBER = rb"(-?\d{1,10})"
_REPLY = re.compile(rb"\[" + rb",".join([_NUMBER] * 8) + rb"\]\r?\n")


class BracketCodec:
    """See `Codec`. Commands are whole milliamperes."""

    def __init__(self) -> None:
        self.skipped = 0
        self._rest = b""

    def encode(self, commands: Sequence[float]) -> bytes:
        a, b, c = commands
        return (b"[%d,%d,%d]\n" % (a, b, c)).ljust(SHORTEST_REQUEST, b"\0")

    def load(self, counts: Sequence[float]) -> None:
        """There is no such request: a button on the board sets the counters to zero."""

    def feed(self, data: bytes) -> list[Reading]:
        if not self._rest and (whole := _REPLY.fullmatch(data)):
            return [_reading(whole)]
        return self._search(self._rest + data)

    def _search(self, data: bytes) -> list[Reading]:
        readings, end = [], 0
        for found in _REPLY.finditer(data):
            self.skipped += found.start() - end
            readings.append(_reading(found))
            end = found.end()
        tail = data[end:]
        begin = tail.rfind(b"[")  # what stands before it can become no reply any more
        remainder = tail[begin:] if begin >= 0 and len(tail) - begin < LONGEST_REPLY else b""
        self.skipped += len(tail) - len(remainder)
        self._rest = remainder
        return readings

    def reset(self) -> None:
        self.skipped += len(self._rest)
        self._rest = b""


def _reading(found: re.Match[bytes]) -> Reading:
    model, a, b, c, *gimbal, error = map(int, found.groups())
    kind = MODELS.get(model, f"number {model}")
    if error:
        return Reading((a, b, c), error_text(error), not 0 <= error < REJECTED, kind)
    return Reading((a, b, c), model=kind, gimbal=tuple(gimbal))


def error_text(error: int) -> str:
    """Return the meaning of an error number; gimbal bits may be combined."""
    gimbal = 0 < error < REJECTED
    parts = [text for bit, text in ERRORS.items() if error == bit or (gimbal and bit < REJECTED and error & bit)]
    return f"{', '.join(parts) or 'unknown'} (error {error})"
