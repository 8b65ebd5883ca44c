"""The binary frames of Haply's hAPI. No sync byte, no length, no checksum: each frame in one write, replies of known length.

    reset   00 id                         setup   01 id motors encoders analog pwm parameters (see `Wiring.setup`)
    torque  02 id pwm... torque_nm...     reply   id analog... angle_deg...        only a torque frame is answered

Numbers are IEEE-754, 32 bits, little-endian; everything is in the order of ports 1 to 4, not of joints. Source: Haply's
firmware M3 1.5 and the hosts in Java, C++ and Python.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from cogrip.devices.arm.exchange import Reading
from cogrip.machine.addition import add_integers

RESET, SETUP, TORQUE = 0, 1, 2
PORTS = (1, 2, 3, 4)
STEP_NM = 1e-5  # step of motor commands: finer than the 12 bits of the firmware
MOST_DEG = 7200.0  # largest angle that is believed: no arm turns so far
WHOLE = 0.02
"""Largest distance of an angle from a whole count. It comes from a counter, and 32 bits are exact to 0.002 counts."""

_FLOAT = struct.Struct("<f")


@dataclass(frozen=True, slots=True)
class Encoder:
    """ccw: which way is positive; offset_deg: the angle at setup; counts_per_turn: of the encoder, x4."""

    ccw: bool
    offset_deg: float
    counts_per_turn: float


def reset_frame(device_id: int) -> bytes:
    """The board forgets its setup. Motors keep their torque."""
    return bytes((RESET, device_id))


@dataclass(frozen=True, slots=True)
class Wiring:
    """Wiring of the joints a, b of one kind of arm to the board, and its maker's home pose."""

    ports: tuple[int, int]
    ccw: tuple[bool, bool]
    counts_per_turn: float
    home_deg: tuple[float, float]

    def setup(self, device_id: int) -> bytes:
        """The setup frame: counters begin at zero now, motors keep their torque. ports: 1 and 2, in either order.

        It lists the joints in the order of their ports, for motors and then for encoders, and neither analog nor PWM pins.
        """
        senses = bytes(ccw for _, ccw in sorted(zip(self.ports, self.ccw, strict=True)))
        wired = bytes((add_integers(1 << (port - 1) for port in self.ports),)) + senses
        return bytes((SETUP, device_id)) + wired * 2 + bytes(2) + struct.pack("<ff", 0.0, self.counts_per_turn) * 2


class HaplyCodec:
    """See `Codec`. Commands are whole steps of STEP_NM for the joints a, b; a third is ignored. Readings are counts.

    Without a sync byte a reply is only believed whole: right length, right id, every angle one that a counter can give.
    Anything else, and all that stands with it, is dropped: the next request is answered by the next reply.
    """

    def __init__(self, wiring: Wiring, device_id: int) -> None:
        self.skipped = 0
        self.wiring = wiring
        self.device_id = device_id
        self._swapped = wiring.ports[0] > wiring.ports[1]
        self._counts_per_deg = wiring.counts_per_turn / 360.0
        self._request = struct.Struct("<BBff")
        self._reply = struct.Struct("<Bff")
        self._rest = b""

    @property
    def reply_bytes(self) -> int:
        return self._reply.size

    def encode(self, commands: Sequence[float]) -> bytes:
        a, b = commands[0] * STEP_NM, commands[1] * STEP_NM
        if self._swapped:
            a, b = b, a
        return self._request.pack(TORQUE, self.device_id, a, b)

    def load(self, counts: Sequence[float]) -> None:
        """Counters begin at zero with the setup, and no other frame sets them."""

    def feed(self, data: bytes) -> list[Reading]:
        if self._rest:
            data = self._rest + data
        size = self._reply.size
        whole = len(data) - len(data) % size
        readings = []
        for begin in range(0, whole, size):
            reading = self._decode(data[begin : begin + size])
            if reading is None:
                return self._drop(data)
            readings.append(reading)
        self._rest = data[whole:]
        if self._rest and self._rest[0] != self.device_id:
            return self._drop(data)
        return readings

    def _drop(self, data: bytes) -> list[Reading]:
        self.skipped += len(data)
        self._rest = b""
        return []

    def _decode(self, reply: bytes) -> Reading | None:
        said, first, second = self._reply.unpack(reply)
        if said != self.device_id:
            return None
        a, b = self._count(first), self._count(second)
        if a is None or b is None:
            return None
        return Reading((b, a, 0.0) if self._swapped else (a, b, 0.0))

    def _count(self, angle_deg: float) -> float | None:
        """Whole counts of an angle; None for what no counter gives."""
        if not isfinite(angle_deg) or abs(angle_deg) > MOST_DEG:
            return None
        count = angle_deg * self._counts_per_deg
        whole = float(round(count))
        if abs(count - whole) > WHOLE or (whole == 0.0 and angle_deg != 0.0):
            return None
        return whole

    def reset(self) -> None:
        self.skipped += len(self._rest)
        self._rest = b""
