"""Sinks: where the messages of a recording go, each a topic's number, a time and JSON text."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

import msgspec

T = TypeVar("T")
encode = msgspec.json.Encoder().encode


class Sink(Protocol):
    """Receiver of messages. `put` is called in the loop: it neither blocks nor raises."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Take a message of the topic with this number, at `time_ns` of the recording's own clock."""


class Nowhere:
    """A sink that drops everything: no recording."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Drop the message."""


class Held:
    """A sink that keeps messages until the real one is known."""

    def __init__(self) -> None:
        self.messages: list[tuple[int, int, bytes]] = []

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        self.messages.append((topic, time_ns, payload))

    def pour(self, sink: Sink) -> None:
        """Move all messages to `sink`, in order."""
        for topic, time_ns, payload in self.messages:
            sink.put(topic, time_ns, payload)
        self.messages.clear()


class ObservedQueue(deque[T]):
    """A queue that calls `observe` with each entry, in order, before it is appended."""

    def __init__(self, observe: Callable[[T], None]) -> None:
        super().__init__()
        self._observe = observe

    def append(self, entry: T) -> None:
        self._observe(entry)
        super().append(entry)

    def extend(self, entries: Iterable[T]) -> None:
        for entry in entries:
            self.append(entry)


def topics(end: str, kinds: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of one end; a message's topic number is its place here."""
    return tuple(f"/{end}/{kind}" for kind in kinds)
