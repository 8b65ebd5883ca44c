"""A recorded core under test, client or server: what was noted is written to a file and played again."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar, assert_never

from cogrip.client.recorder import RecordedClient
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Gap, kind_of
from cogrip.protocol.recording.sink import HeldSink, encode
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, Kind
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Frame, Heartbeat, Intent, Partner, Power, Stamp, State, Waves
from cogrip.results.replay.verify import ReplayVerdict, verify
from cogrip.server.recorder import RecordedServer

from tests.recording_files import written

Put = tuple[int, int, bytes]  # topic, time, payload
Row = tuple[float, ...]


class RecordedEnd:
    """The recording of a core, and verdicts on it: as it is, or altered."""

    role: ClassVar[str]
    who: ClassVar[str]
    file: ClassVar[str]
    rate_hz: ClassVar[int]

    def __init__(self, core: RecordedClient | RecordedServer, topics: tuple[str, ...]) -> None:
        self.core = core
        self.topics = topics
        self.held = HeldSink()
        core.record(self.held)

    @property
    def noted(self) -> list[Put]:
        return self.held.messages

    def ticks_in(self, noted: Sequence[Put]) -> int:
        """Ticks or steps."""
        raise NotImplementedError

    def places(self, *kinds: str) -> list[int]:
        """Return the places of messages of these kinds."""
        return [at for at, (topic, *_) in enumerate(self.noted) if kind_of(self.topics[topic]) in kinds]

    def verdict(self, noted: Sequence[Put] | None = None, closed: bool = True) -> ReplayVerdict:
        """Write `noted` (else all that was noted) to a file, and verify that."""
        header = Header(self.role, self.who, self.core.start, self.rate_hz, 1, 5, True, versions_here(), self.topics)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / self.file
            with written(path, header, closed) as writer:
                for message in self.noted if noted is None else noted:
                    writer.put(*message)
            return verify(open_recording(path))

    def altered(self, at: int, payload: bytes, time_ns: int | None = None) -> ReplayVerdict:
        """With another payload, or at another time."""
        topic, now_ns, _ = self.noted[at]
        new = (topic, now_ns if time_ns is None else time_ns, payload)
        return self.verdict([*self.noted[:at], new, *self.noted[at + 1 :]])

    def misses(self, at: int) -> None:
        """Leave a message out: that is found, and not before it would have come."""
        time_ns = self.noted[at][1]
        verdict = self.verdict([*self.noted[:at], *self.noted[at + 1 :]])
        assert verdict.difference is not None
        assert verdict.difference.time_ns >= time_ns
        assert verdict.messages >= sum(each < time_ns for _, each, _ in self.noted), "all before it is the same"

    def exact(self) -> None:
        verdict = self.verdict()
        assert verdict.exact, verdict.difference
        assert verdict.messages == len(self.noted)
        assert verdict.ticks == self.ticks_in(self.noted)
        assert not verdict.cut
        assert verdict.versions == ()


# What holds for every recording ---------------------------------------------------------------------------------------


def the_beginning_is_exact(end: RecordedEnd, length: int) -> ReplayVerdict:
    """A chunk may end between any two messages: between what a tick sent and the tick itself, too."""
    verdict = end.verdict(end.noted[:length], closed=False)
    assert verdict.difference is None, (length, verdict.difference)
    assert verdict.exact
    assert verdict.cut
    return verdict


def nothing_is_judged_after_a_gap(end: RecordedEnd, at: int) -> ReplayVerdict:
    """Three messages from `at` on were not recorded."""
    gap = Gap(3, "the ring was full")
    topic = next(number for number, name in enumerate(end.topics) if kind_of(name) == "gap")
    gap_ns = end.noted[min(at, len(end.noted) - 1)][1]
    verdict = end.verdict([*end.noted[:at], (topic, gap_ns, encode(gap)), *end.noted[at + 3 :]])
    assert verdict.difference is None
    assert (verdict.hole, verdict.hole_ns) == (gap, gap_ns)
    assert not verdict.exact
    assert not verdict.cut, "the file was closed"
    return verdict


# Words that arrive ----------------------------------------------------------------------------------------------------


def flipped(datagram: bytes, place: int, bits: int) -> bytes:
    """One byte of it changed."""
    data = bytearray(datagram or b"x")
    data[place % len(data)] ^= bits
    return bytes(data)


def mangled(said: Sequence[bytes], number: int) -> dict[str, bytes]:
    """Return one of these datagrams as a network or an attacker changes it, or bytes that never were one; `number` selects."""
    one = said[number % len(said)]
    return {
        "again": one,
        "flipped": flipped(one, number, 1 << number % 8),
        "cut": one[: number % 60],
        "garbage": number.to_bytes(8, "big") * (number % 20),
        "too long": bytes(2000),
    }


def well_formed(session: int, number: int, row: Row, value: float) -> dict[str, bytes]:
    """Messages of the session or a strange one; `number` tells which of that kind."""
    stamp, largest, total = Stamp(number * 1000), tuple(1e4 * each for each in row), tuple(1e15 * each for each in row)
    made = {
        "stranger": Heartbeat(session % 1000 + 1 + number, stamp),
        "heartbeat": Heartbeat(session, stamp),
        "state": State(session, number, row, row, value, 0, stamp),
        "power": Power(session, number, row, row, row, (1e15,) * len(row), (0.0,) * len(row), value, 0, stamp),
        "hostile": Waves(session, number, largest, total, (1e15,) * len(row), 0.0, 0.0, number, stamp, row + row),
    }
    return {kind: messages.encode(message) for kind, message in made.items()}


def next_frame(line: LineSender, session: int, row: Row, stamp: Stamp, kind: Kind, up: bool) -> bytes:
    """The next frame of a line up or down, as a coupling of that kind carries it: with another person's intention where it
    has models, and up with the proxy where the client renders contact."""
    line.push(row)
    first, waves, total, squares = line.contents()
    place = tuple(each * 0.01 for each in row)
    proxy = place if up and COUPLING_KINDS[kind].local else ()
    number, power = line.next_number - 1, tuple(each * each for each in row)
    frame: Frame
    match COUPLING_KINDS[kind].frame:
        case "Waves":
            frame = Waves(session, first, waves, total, squares, 0.0, 0.0, 0, stamp, place + place + proxy)
        case "State":
            frame = State(session, number, place, place, 0.0, 0, stamp)
        case "Power":
            frame = Power(session, number, place, place, row, power, power, 0.0, 0, stamp)
        case "Partner":
            intent = Intent(1, 0, place, row, 100.0, number * 1e-6)
            frame = Partner(session, number, place, row, (intent,), 0, stamp)
        case other:
            assert_never(other)
    return messages.encode(frame)
