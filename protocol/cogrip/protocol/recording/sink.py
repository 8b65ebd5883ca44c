"""Sinks: where the messages of a recording go, each a topic's number, a time and a record; and the recorder of a core.

A recorder stands around a core. Every input is recorded and then handled by the core; replay hands the recorded inputs to a
new core. A tick or a step is one record of its input and its result, written when the result is known.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

import msgspec

from cogrip.protocol.recording.records import Input, Record

T = TypeVar("T")
encode = msgspec.json.Encoder().encode
pack = msgspec.msgpack.Encoder().encode
_unpack = msgspec.msgpack.Decoder().decode


def text_of(payload: bytes) -> bytes:
    """Return the JSON text of a record that is JSON text or MessagePack: to the byte what `encode` makes of the record."""
    return payload if payload[:1] == b"{" else encode(_unpack(payload))


class Sink(Protocol):
    """Receiver of messages. `put` is called in the loop: it neither blocks nor raises."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Take a message of the topic with this number, at `time_ns` of the recording's own clock."""


class Nowhere:
    """A sink that drops everything: no recording."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Drop the message."""


class HeldSink:
    """A sink that keeps messages until the real one is known."""

    def __init__(self) -> None:
        self.messages: list[tuple[int, int, bytes]] = []

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        self.messages.append((topic, time_ns, payload))


class CoreRecorder:
    """Recorder of one core, client or server: records are held until `record` says where they go.

    keeps  False where nobody keeps the recording, so that nothing need be encoded
    sink   where messages go
    """

    def __init__(self) -> None:
        self._held = HeldSink()
        self.sink: Sink = self._held
        self._encode: Callable[[Record], bytes] = encode
        self.keeps = True

    def record(self, sink: Sink, encode: Callable[[Record], bytes] = encode) -> None:
        """Write to `sink` what was held, and all that follows.

        encode: makes a message of a record: JSON text, or for a reader that makes the text itself (`text_of`) MessagePack, in
        half the time
        """
        self.sink, self._encode = sink, encode
        self.keeps = not isinstance(sink, Nowhere)
        for message in self._held.messages:
            sink.put(*message)
        self._held.messages.clear()

    def put(self, topic: int, time_ns: int, record: Record) -> None:
        """Write one record. topic: its place among the topics of this recording."""
        if self.keeps:
            self.sink.put(topic, time_ns, self._encode(record))

    def put_input(self, topic: int, time_ns: int, given: msgspec.Struct) -> None:
        """Write an input of the core: a tagged struct of its `inputs` module, as JSON text."""
        if self.keeps:
            self.put(topic, time_ns, Input(str(given.__struct_config__.tag), encode(given).decode()))


class ObservedQueue(deque[T]):
    """A queue that calls `observe`, if there is one, with each entry, in order, before it is appended."""

    def __init__(self, observe: Callable[[T], None]) -> None:
        super().__init__()
        self.observe: Callable[[T], None] | None = observe

    def append(self, entry: T) -> None:
        if self.observe is not None:
            self.observe(entry)
        deque.append(self, entry)  # `super` costs as much as three calls

    def extend(self, entries: Iterable[T]) -> None:
        if self.observe is None:
            deque.extend(self, entries)
            return
        for entry in entries:
            self.append(entry)


def topics(end: str, kinds: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of one end; a message's topic number is its place here."""
    return tuple(f"/{end}/{kind}" for kind in kinds)
