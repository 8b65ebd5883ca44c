"""Comparison of the messages of a replay with the recorded ones, one by one, byte for byte."""

import json
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from cogrip.protocol.recording.reader import RecordedMessage

NOTHING = "nothing"


@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first message that is not the same. Values are JSON text; NOTHING where one side has no such message."""

    time_ns: int
    topic: str
    field: str
    recorded: str
    replayed: str


class ReplayComparison:
    """A `Sink` for the replayed messages; `expect` takes the recorded ones. Either may run ahead of the other."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = topics
        self._recorded: deque[RecordedMessage] = deque()
        self._replayed: deque[RecordedMessage] = deque()
        self.equal = 0
        self.difference: FirstDifference | None = None

    def expect(self, message: RecordedMessage) -> None:
        if self._replayed:
            self._compare(message, self._replayed.popleft())
        else:
            self._recorded.append(message)

    def put(self, topic: int, time_ns: int, payload: bytes) -> None:
        """See `Sink.put`."""
        message = RecordedMessage(topic, time_ns, payload)
        if self._recorded:
            self._compare(self._recorded.popleft(), message)
        else:
            self._replayed.append(message)

    def finish(self) -> None:
        """Take messages that only one side has as a difference: the recording is whole.

        Of one that was cut, the last outputs may be missing, or the input that they came of.
        """
        for message in self._recorded:
            self._differ(message, "", _text(message), NOTHING)
        for message in self._replayed:
            self._differ(message, "", NOTHING, _text(message))

    def untold(self, time_ns: int, topic: str) -> None:
        """Note that the core asked for an answer that the recording should hold and does not."""
        if self.difference is None:
            self.difference = FirstDifference(time_ns, topic, "", NOTHING, "an answer was asked for")

    def _compare(self, recorded: RecordedMessage, replayed: RecordedMessage) -> None:
        if recorded == replayed:
            self.equal += 1
        elif recorded.topic != replayed.topic:
            there, here = self._topics[recorded.topic], self._topics[replayed.topic]
            self._differ(recorded, "", f"{there} {_text(recorded)}", f"{here} {_text(replayed)}")
        elif difference := _first_field(recorded.payload, replayed.payload):
            self._differ(recorded, *difference)
        elif recorded.time_ns != replayed.time_ns:
            self._differ(recorded, "time_ns", str(recorded.time_ns), str(replayed.time_ns))
        else:
            self.equal += 1

    def _differ(self, message: RecordedMessage, where: str, recorded: str, replayed: str) -> None:
        if self.difference is None:
            self.difference = FirstDifference(message.time_ns, self._topics[message.topic], where, recorded, replayed)


def _text(message: RecordedMessage) -> str:
    return message.payload.decode("utf-8", "replace")


def _first_field(recorded: bytes, replayed: bytes) -> tuple[str, str, str] | None:
    """Return (path, recorded value, replayed value) of the first difference of two JSON messages; None where there is none."""
    if recorded == replayed:
        return None
    try:
        one, other = json.loads(recorded), json.loads(replayed)
    except ValueError:
        return "", recorded.decode("utf-8", "replace"), replayed.decode("utf-8", "replace")
    return _descend(one, other, "")


def _descend(one: Any, other: Any, where: str) -> tuple[str, str, str]:
    pairs: list[tuple[str, Any, Any]] = []
    if isinstance(one, dict) and isinstance(other, dict):
        keys = [*one, *(key for key in other if key not in one)]
        pairs = [(f"{where}.{key}" if where else key, one.get(key, NOTHING), other.get(key, NOTHING)) for key in keys]
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = [(f"{where}[{number}]", *pair) for number, pair in enumerate(zip(one, other, strict=True))]
    for path, left, right in pairs:
        if json.dumps(left) != json.dumps(right):  # as text: 0.0 and -0.0 are not the same bits
            return _descend(left, right, path)
    return where, json.dumps(one), json.dumps(other)
