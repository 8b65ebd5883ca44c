"""Tests of recorded delays: values over time, repetition, errors of files, and the example that makes one of a recorded run."""

import runpy
from pathlib import Path

import pytest

from cogrip.protocol.settings.room import resolve
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.sim.delay_trace import LOST_NS, DelayTrace, TraceError, read_trace
from cogrip.sim.link import LinkEmulator

from tests.sim.test_link import MS, Profile, S, arrivals

ROWS = [(10.0, 5.0), (11.0, 50.0), (11.5, None), (12.0, 10.0)]


def test_a_row_holds_until_the_next_and_the_trace_begins_again() -> None:
    trace = DelayTrace(ROWS)
    lost = LOST_NS / MS
    expected = {0.0: 5, 0.999: 5, 1.0: 50, 1.499: 50, 1.5: lost, 1.999: lost, 2.0: 10, 2.499: 10, 2.5: 5, 3.5: 50}
    for at_s, delay_ms in expected.items():
        for turn in (0, 4):
            assert trace.delay_ns(round((at_s + turn * 2.5) * S)) == delay_ms * MS


@pytest.mark.parametrize("delay_ms", [7.0, 10_000.0])
def test_one_row_is_a_constant_up_to_the_longest_delay(delay_ms: float) -> None:
    trace = DelayTrace([(0.0, delay_ms)])
    assert {trace.delay_ns(each) for each in (0, 1, S, 10**15)} == {delay_ms * MS}


def test_a_link_adds_the_trace_by_the_time_of_sending_and_draws_nothing_for_it() -> None:
    rough = Profile(delay_ms=3, jitter_ms=2, loss=0.2, burst_frames=2, duplicate=0.3)
    plain, traced = LinkEmulator(rough, "t"), LinkEmulator(rough, "t", trace=DelayTrace(ROWS))
    sent_ns = {}
    for number in range(400):
        payload, now_ns = number.to_bytes(2, "big"), 77 * S + number * 10 * MS
        sent_ns[payload] = now_ns
        plain.send(payload, now_ns)
        traced.send(payload, now_ns)

    def took(link: LinkEmulator) -> dict[bytes, list[int]]:
        found: dict[bytes, list[int]] = {}
        for arrival_ns, payload in arrivals(link):
            found.setdefault(payload, []).append(arrival_ns - sent_ns[payload])
        return found

    trace = DelayTrace(ROWS)
    expected = {}
    for payload, each in took(plain).items():
        delay_ns = trace.delay_ns(sent_ns[payload] - 77 * S)
        if delay_ns != LOST_NS:
            expected[payload] = [one + delay_ns for one in each]
    assert took(traced) == expected
    assert traced.lost > plain.lost
    assert traced.sent + traced.duplicated == traced.delivered + traced.lost


def test_a_file_is_read_once_its_columns_are_found_and_a_byte_order_mark_is_passed_over(tmp_path) -> None:
    file = tmp_path / "t.csv"
    file.write_text("seq, delay_ms, t_s\n1,5.5,0\n\n2,lost,1\n3,,2\n4,6,3\n")
    trace = read_trace(file)
    assert [trace.delay_ns(each * S) for each in range(4)] == [5.5 * MS, LOST_NS, LOST_NS, 6 * MS]
    assert read_trace(file) is trace, "all links of a session have one"
    file.write_text("t_s,delay_ms\n0,4\n1,3\n", encoding="utf-8-sig")
    assert [read_trace(file).delay_ns(each * S) for each in range(3)] == [4 * MS, 3 * MS, 4 * MS]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "1: the first line is ''; it must name the columns t_s and delay_ms"),
        ("t_s,delay\n0,1\n", "1: the first line is 't_s,delay'"),
        ("t_s,delay_ms\n", "there are no rows"),
        ("t_s,delay_ms\n0,1\n0,1\n", "3: t_s = 0 is not after the row before it"),
        ("t_s,delay_ms\n0,-1\n", "2: delay_ms = -1 is outside 0 to 10000; leave it empty where it was lost"),
        ("t_s,delay_ms\n0,10001\n", "2: delay_ms = 10001 is outside"),
        ("t_s,delay_ms\n0,nan\n", "2: delay_ms = 'nan' is no number"),
        ("t_s,delay_ms\nx,1\n", "2: t_s = 'x' is no number"),
        ("t_s,delay_ms\n0\n", "2: 1 columns, and 2 are named"),
        ("t_s,delay_ms\n0,1\n1e300,1\n", "3: t_s = 1e[+]300 is more than 1e[+]06 s after"),
        ("t_s,delay_ms\n0,1\n-1e300,1\n", "3: t_s = -1e[+]300 is not after the row before it"),
        ("t_s,delay_ms\n-1e308,1\n1e308,1\n", "3: t_s = 1e[+]308 is more than 1e[+]06 s after"),
        ("t_s,delay_ms\n0,1\n2000000,1\n", "3: t_s = 2e[+]06 is more than 1e[+]06 s after"),
    ],
)
def test_what_is_said_of_a_file_that_is_no_trace(tmp_path, text: str, words: str) -> None:
    (file := tmp_path / "t.csv").write_text(text)
    with pytest.raises(TraceError, match=words) as caught:
        read_trace(file)
    assert str(file) in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path) -> None:
    with pytest.raises(TraceError, match=r"none\.csv: cannot be read: No such file"):
        read_trace(tmp_path / "none.csv")
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\n")
    with pytest.raises(TraceError, match="cannot be read"):
        read_trace(tmp_path / "bytes.csv")


# The example

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "record_a_trace.py"
FRAME_NS = 7_812_500
LINK = {"delay_ms": 31.25, "loss": 0.3, "burst_frames": 3.0}
EXAMPLE_MAIN = runpy.run_path(str(EXAMPLE))["main"]


@pytest.mark.parametrize(("kind", "direction"), [("wave", "up"), ("wave", "down"), ("tdpa", "up"), ("tdpa", "down")])
def test_a_recorded_network_can_be_played(tmp_path, capsys, kind: str, direction: str) -> None:
    run_laboratory(
        resolve({"seconds": 1.0, "seed": 4, "link": LINK, "playout": {"frames": 2}, "coupling": {"kind": kind}}),
        tmp_path,
    )
    assert EXAMPLE_MAIN([str(tmp_path), "anna", direction]) == 0
    told = capsys.readouterr().out
    (tmp_path / "trace.csv").write_text(told)
    delays = [row.partition(",")[2] for row in told.splitlines()[1:]]
    assert set(delays) == {"", "31.250"}
    assert 10 < delays.count("") < 100
    assert 100 < len(delays) <= 124, "of 128 frames the last four were under way when the session ended"
    assert delays[-1], "nothing follows the newest that came"
    link = LinkEmulator(Profile(), "", trace=read_trace(tmp_path / "trace.csv"))
    for number in range(len(delays)):
        link.send(number.to_bytes(1, "big"), 5 + number * FRAME_NS)
    assert arrivals(link) == [
        (5 + number * FRAME_NS + 31.25 * MS, bytes([number])) for number, delay in enumerate(delays) if delay
    ]


def test_bad_arguments_and_incomplete_runs_are_refused(tmp_path, capsys) -> None:
    run = tmp_path / "run"
    run.mkdir()
    run_laboratory(resolve({"seconds": 0.1, "link": {"delay_ms": 500.0}}), run)
    for arguments, words in (
        ([], "usage: record_a_trace.py RUN PERSON up|down"),
        ([str(run), "anna"], "usage"),
        ([str(run), "anna", "left"], "'left' is no direction: up is from the client to the server"),
        ([str(run), "zoe", "up"], "no recording of 'zoe'; there is: anna\n"),
        ([str(run), "anna", "up"], "nothing of anna up arrived"),
        ([str(tmp_path / "none"), "anna", "up"], "none"),
    ):
        assert EXAMPLE_MAIN(arguments) == 2
        told = capsys.readouterr()
        assert words in told.err
        assert not told.out
    (run / "server.mcap").unlink()
    assert EXAMPLE_MAIN([str(run), "anna", "up"]) == 2
    assert "no recording of the server; bring both together by `cogrip merge`" in capsys.readouterr().err
