"""The part of a core's recorder that client and server share.

A recorder stands around a core. Every input is recorded and then handled by the core; replay hands the recorded inputs to a
new core. A tick or a step is one record of its input and its result, written when the result is known.
"""

import msgspec

from cogrip.protocol.recording.records import Input, Record
from cogrip.protocol.recording.sink import Held, Nowhere, Sink, encode


class CoreRecorder:
    """Messages are held until `record` says where they go.

    keeps   False where nobody keeps the recording, so that nothing need be encoded
    now_ns  time of the input that is being handled, given to all that comes of it
    """

    def __init__(self) -> None:
        self._held = Held()
        self._sink: Sink = self._held
        self.keeps = True
        self.now_ns = 0

    def record(self, sink: Sink) -> None:
        """Write to `sink` what was held, and all that follows."""
        self._sink = sink
        self.keeps = not isinstance(sink, Nowhere)
        self._held.pour(sink)

    def put(self, topic: int, record: Record) -> None:
        """Write one record at `now_ns`. topic: its place among the topics of this recording."""
        if self.keeps:
            self._sink.put(topic, self.now_ns, encode(record))

    def put_input(self, topic: int, given: msgspec.Struct) -> None:
        """Write an input of the core: a tagged struct of its `inputs` module, as JSON text."""
        if self.keeps:
            kind = given.__struct_config__.tag
            self._sink.put(topic, self.now_ns, encode(Input(str(kind), encode(given).decode())))
