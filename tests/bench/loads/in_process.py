"""A server core in this process, and people who are messages prepared for it: what its own work takes, without a socket."""

import itertools
import math
import time
from dataclasses import dataclass

from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.wire.messages import Stamp
from cogrip.protocol.wire.session import ClientSession, make_hello
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import ServerCore

from tests.bench.loads.people import PEAK_N, SPEED_MPS, Swing, room_name
from tests.bench.loads.server import NETWORK_HZ, Job, settings_of

FRAME_NS = 1_000_000_000 // NETWORK_HZ
SETTLE_FRAMES = 64
SPIN_NS = 200_000


@dataclass(frozen=True, slots=True)
class Spent:
    """Processor time of this thread, a person and frame [us]."""

    receive_us: float
    tick_us: float

    @property
    def all_us(self) -> float:
        return self.receive_us + self.tick_us


def spent(people: int, per_room: int, axes: int, frames: int, pace: str) -> Spent:
    """Return what `frames` of so many people take. pace: "none" back to back, "sleep" at 128 Hz, "spin" awake in between."""
    settings = settings_of(Job("unencrypted", people, per_room, axes))
    numbers = itertools.count(1)
    core = ServerCore(settings, "bench", AdmissionServices(lambda: next(numbers)))
    sessions = [_join(core, number, per_room, axes) for number in range(people)]
    total = SETTLE_FRAMES + frames
    lines = [Swing(seat_settings(settings[0], 0), 0.5 * math.pi * each) for each in range(4)]
    prepared: list[list[bytes]] = []
    for frame in range(total):
        for line in lines:
            line.step()
        stamp = Stamp(frame * FRAME_NS, 0, 0)
        prepared.append([lines[each % 4].message(session, frame, stamp) for each, session in enumerate(sessions)])
    receive_ns = tick_ns = 0
    due_ns = time.monotonic_ns()
    for frame, messages in enumerate(prepared):
        due_ns += FRAME_NS
        if pace != "none":
            _wait(due_ns, pace == "spin")
        now_ns = frame * FRAME_NS
        begun_ns = time.thread_time_ns()
        for number, message in enumerate(messages):
            core.receive(message, number, now_ns)
        received_ns = time.thread_time_ns()
        for room in core.rooms:
            core.tick(room, now_ns)
            core.outbox.clear()
        core.events.clear()
        if frame >= SETTLE_FRAMES:
            receive_ns += received_ns - begun_ns
            tick_ns += time.thread_time_ns() - received_ns
    applied = sum(seat.port.count().applied for room in core.rooms for seat in room.seats if seat.port)
    if applied < 0.9 * frames * people:
        raise RuntimeError(f"{applied} of {frames * people} frames were applied: {dict(core.dropped)}")
    scale = 1e-3 / frames / people
    return Spent(receive_ns * scale, tick_ns * scale)


def _join(core: ServerCore, number: int, per_room: int, axes: int) -> int:
    """Take a seat, at an address that is this number. Returns the session's number."""
    hello = make_hello(
        software="bench", nonce=number + 1, room=room_name(number // per_room), name="", digest="", device="sim:light",
        axes=max(3, axes), rate_hz=8192.0, force_n=PEAK_N, speed_mps=SPEED_MPS,
    )  # fmt: skip
    session = ClientSession(hello)
    session.connect(0)
    while session.state != "seated":
        while session.outbox:
            core.receive(session.outbox.popleft(), number, 0)
        if not core.outbox:
            raise RuntimeError(f"person {number} got no seat: {session.failed}")
        while core.outbox:
            _, answer = core.outbox.popleft()
            session.receive(answer, 0)
    assert session.welcome is not None
    return session.welcome.session


def _wait(due_ns: int, spin: bool) -> None:
    if not spin:
        time.sleep(max(0, due_ns - SPIN_NS - time.monotonic_ns()) * 1e-9)
    while time.monotonic_ns() < due_ns:
        pass
