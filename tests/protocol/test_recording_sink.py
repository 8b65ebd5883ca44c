"""Records on their way to the writer: MessagePack in the loop, JSON text in the file, the same to the byte."""

from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.drawing import Shape
from cogrip.protocol.recording.records import KINDS, Event, Record
from cogrip.protocol.recording.sink import CoreRecorder, HeldSink, Nowhere, encode, pack, text_of

from tests.protocol.valid_values import valid

numbers = st.floats() | st.integers(-(2**53), 2**53)  # a driver of another author may give 2 for 2.0
shapes = st.just(Shape("box", (0.1, 0.2, 0.3)))
records = st.one_of([valid(each, {Shape: shapes}, free=numbers) for each in KINDS.values()])


@given(records)
def test_the_text_of_a_packed_record_is_the_records_own(record: Record) -> None:
    assert text_of(pack(record)) == encode(record)
    assert text_of(encode(record)) == encode(record)


def test_what_was_held_is_text_and_what_follows_as_the_sink_wants_it() -> None:
    recorder, sink = CoreRecorder(), HeldSink()
    recorder.put(1, 0, Event("before"))
    recorder.record(sink, pack)
    recorder.put(2, 0, Event("after"))
    assert [(topic, text_of(payload)) for topic, _, payload in sink.messages] == [
        (1, b'{"text":"before"}'), (2, b'{"text":"after"}')
    ]  # fmt: skip
    assert [payload[:1] == b"{" for _, _, payload in sink.messages] == [True, False]
    recorder.record(Nowhere(), pack)
    assert not recorder.keeps
