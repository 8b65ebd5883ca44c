"""The ring of rows that loops write and others read."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.io.trace import TraceReader, TraceWriter, open_trace

COLUMNS = ("time_s", "x", "y")


def writer_at(path, seconds=1.0, rate_hz=4):
    return TraceWriter(path, COLUMNS, rate_hz=rate_hz, seconds=seconds, who="anna", start_ns=7)


def rows_of(reader):
    body, oldest = reader.body()
    flat = struct.unpack(f"<{len(body) // 8}d", body)
    body.release()
    rows = [flat[at : at + len(COLUMNS)] for at in range(0, len(flat), len(COLUMNS))]
    return rows[oldest:] + rows[:oldest]


@given(written=st.integers(0, 60))
def test_a_reader_sees_the_newest_rows_in_order(tmp_path_factory, written):
    path = tmp_path_factory.mktemp("trace") / "a.trace"
    writer = writer_at(path)  # room for 12 rows
    for number in range(written):
        writer.append((number / 4, number, -number))
    reader = TraceReader(path)
    assert reader.count == written
    assert (reader.who, reader.rate_hz, reader.start_ns, reader.columns) == ("anna", 4, 7, COLUMNS)
    expected = [(number / 4, number, -number) for number in range(max(0, written - reader.capacity), written)]
    assert rows_of(reader) == expected
    newest = reader.newest()
    assert newest is None if not written else newest == dict(zip(COLUMNS, expected[-1], strict=True))
    reader.close()
    writer.close()
    closed = TraceReader(path)
    assert rows_of(closed) == expected, "closing loses nothing"
    closed.close()


def test_closing_gives_back_what_was_not_written(tmp_path):
    writer = writer_at(tmp_path / "a.trace", seconds=10_000)
    before = (tmp_path / "a.trace").stat().st_size
    writer.append((0.0, 1.0, 2.0))
    writer.close()
    assert (tmp_path / "a.trace").stat().st_size < before / 10


def test_a_trace_is_never_overwritten(tmp_path):
    writer_at(tmp_path / "a.trace").close()
    with pytest.raises(FileExistsError):
        writer_at(tmp_path / "a.trace")


@pytest.mark.parametrize("content", [b"x", b"nonsense" * 8192])
def test_what_is_no_trace_is_refused(tmp_path, content):
    (tmp_path / "a.trace").write_bytes(content)
    with pytest.raises(ValueError, match="not a cogrip trace"):
        TraceReader(tmp_path / "a.trace")


def test_the_start_may_be_told_later(tmp_path):
    writer = writer_at(tmp_path / "a.trace")
    writer.begin(4711)
    writer.append((0.0, 1.0, 2.0))
    writer.close()
    reader = TraceReader(tmp_path / "a.trace")
    assert reader.start_ns == 4711
    assert rows_of(reader) == [(0.0, 1.0, 2.0)]
    reader.close()


def test_a_session_goes_on_where_no_trace_can_be_had(tmp_path):
    said = []
    (tmp_path / "a.trace").touch()
    for path in (tmp_path / "a.trace", tmp_path / "missing" / "a.trace"):
        assert open_trace(path, COLUMNS, rate_hz=4, seconds=1, who="anna", say=said.append) is None
    assert [words.startswith("no trace of this session") for words in said] == [True, True]
    assert open_trace(None, COLUMNS, rate_hz=4, seconds=1, who="anna", say=said.append) is None
    assert len(said) == 2
