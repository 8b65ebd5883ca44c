"""The messages of a recording in the order in which they happened, with a view ahead to the answers that a core was given."""

from collections import deque
from collections.abc import Iterator

import msgspec

from cogrip.protocol.recording.derived import DERIVED
from cogrip.protocol.recording.reader import Damage, RecordedMessage, Recording
from cogrip.protocol.recording.records import KINDS, Answer, Clock, Gap, kind_of

_answer = msgspec.json.Decoder(Answer).decode


class UntoldError(Exception):
    """A core asks for an answer that the recording does not hold: nothing after this can be replayed."""


class ReplayInput:
    """Iterate once. The recorder's own messages, derived ones too, are taken out; it ends early at the first `hole`.

    cut  it was read to its end, behind which messages are missing
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self.kinds = [kind_of(topic) for topic in recording.topics]
        self.hole: Damage | Gap | None = None
        self.hole_ns: int | None = None
        self.cut = False
        self.first_ns: int | None = None
        self.last_ns = 0
        self._messages = self._read()
        self._ahead: deque[RecordedMessage] = deque()
        self._answers: deque[Answer] = deque()

    def _read(self) -> Iterator[RecordedMessage]:
        recording = self.recording
        for chunk in recording.chunks():
            if recording.damage:  # between the chunk before and this one something is missing
                self.hole, self.hole_ns = recording.damage[0], recording.damage[0].from_ns
                return
            for message in chunk:
                kind = self.kinds[message.topic]
                if kind in DERIVED:
                    continue
                record = KINDS.get(kind)
                if record is Gap:
                    self.hole, self.hole_ns = msgspec.json.decode(message.payload, type=Gap), message.time_ns
                    return
                if record is not Clock:
                    yield message
        self.cut = recording.cut or not recording.complete
        if recording.complete and recording.damage:
            self.hole, self.hole_ns = recording.damage[0], recording.damage[0].from_ns

    def _take(self, message: RecordedMessage) -> None:
        self._ahead.append(message)
        if self.kinds[message.topic] == "answer":
            self._answers.append(_answer(message.payload))

    @property
    def whole(self) -> bool:
        """Nothing is known to be missing of what was read so far."""
        return self.hole is None and not self.cut

    def __iter__(self) -> Iterator[RecordedMessage]:
        while True:
            if not self._ahead:
                following = next(self._messages, None)
                if following is None:
                    return
                self._take(following)
            message = self._ahead.popleft()
            if self.first_ns is None:
                self.first_ns = message.time_ns
            self.last_ns = message.time_ns
            yield message

    def answer(self) -> Answer:
        """Return the next answer that the core was given. Raises UntoldError if there is none."""
        while not self._answers:
            following = next(self._messages, None)
            if following is None:
                raise UntoldError
            self._take(following)
        return self._answers.popleft()
