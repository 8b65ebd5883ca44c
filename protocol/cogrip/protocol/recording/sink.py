"""Where the messages of a recording go: a topic's number, a time, and JSON text."""

from collections.abc import Sequence
from typing import Protocol

import msgspec

encode = msgspec.json.Encoder().encode


class Sink(Protocol):
    """Takes messages. `put` is called in the loop: it neither blocks nor raises."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """A message of the topic with this number, at `time_ns` of the recording's own clock."""
        ...


class Nowhere:
    """No recording."""

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """Let it go."""


class Held:
    """Keeps messages until there is somewhere to put them."""

    def __init__(self) -> None:
        self.messages: list[tuple[int, int, bytes]] = []

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        self.messages.append((topic, time_ns, payload))

    def pour(self, sink: Sink) -> None:
        """Give everything away, in order."""
        for topic, time_ns, payload in self.messages:
            sink.put(topic, time_ns, payload)
        self.messages.clear()


def topics(end: str, kinds: Sequence[str]) -> tuple[str, ...]:
    """Topics of one end; a message's topic number is its place here."""
    return tuple(f"/{end}/{kind}" for kind in kinds)
