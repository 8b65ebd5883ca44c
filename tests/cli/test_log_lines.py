"""Log of a server, for people and for programs; readers that are gone or do not read; names that peers choose."""

import io
import json
import os
import pty
import subprocess
import sys
import tty
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.cli.serving.log_lines import LONGEST_BYTES, LONGEST_TEXT, WARNINGS, LogLines
from cogrip.server.events import EVENTS, ServerEvent

AT = datetime(2026, 3, 4, 5, 6, 7, 89_500, tzinfo=timezone(timedelta(hours=1)))
JOINED = ServerEvent("joined", "lab: anna joined from 10.0.0.7:5", "lab", "anna", "10.0.0.7:5", token="k3")
ANY = st.text(st.characters(exclude_categories=()), max_size=60)  # lone surrogates as well


def said(form: str, *what: ServerEvent | str) -> str:
    stream = io.StringIO()
    lines = LogLines(form, stream, lambda: AT)
    for each in what:
        lines.say(each)
    assert lines.lost == 0
    return stream.getvalue()


def test_text_is_the_words_and_json_has_the_fields_that_are_set():
    words = "lab: anna joined from 10.0.0.7:5\nlistening on [::1]:47800; rooms: lab\n"
    assert said("text", JOINED, "listening on [::1]:47800; rooms: lab") == words
    assert [json.loads(line) for line in said("json", JOINED, "listening", "warning: it is open").splitlines()] == [
        {
            "time": "2026-03-04T05:06:07.089+01:00", "level": "info", "event": "joined",
            "text": "lab: anna joined from 10.0.0.7:5", "room": "lab", "user": "anna", "address": "10.0.0.7:5", "token": "k3",
        },
        {"time": "2026-03-04T05:06:07.089+01:00", "level": "info", "event": "notice", "text": "listening"},
        {"time": "2026-03-04T05:06:07.089+01:00", "level": "warning", "event": "notice", "text": "warning: it is open"},
    ]  # fmt: skip


@pytest.mark.parametrize("event", EVENTS)
def test_events_for_an_administrator_are_warnings(event):
    information = (
        "joined",
        "observes",
        "resumed",
        "left",
        "restored",
        "reloaded",
        "opened",
        "closed",
        "marker",
        "hand",
        "trigger",
    )
    level = json.loads(said("json", ServerEvent(event, "x")))["level"]
    assert level == ("info" if event in information else "warning")
    assert set(WARNINGS) <= set(EVENTS)


def test_the_time_is_now_and_has_an_offset():
    stream = io.StringIO()
    before = datetime.now(UTC)
    LogLines("json", stream).say("x")
    found = datetime.fromisoformat(json.loads(stream.getvalue())["time"])
    assert found.utcoffset() is not None
    assert before - timedelta(milliseconds=1) <= found <= datetime.now(UTC)


@given(ANY, ANY)
def test_any_name_of_a_peer_is_one_line(text, user):
    event = ServerEvent("refused", text, user=user)
    (line,) = said("json", event).splitlines()
    assert line.isascii()
    assert line.isprintable()
    fields = json.loads(line)
    assert (fields["text"], fields.get("user", "")) == (text, user)
    for what in (event, text):
        shown = said("text", what)
        assert shown.count("\n") == 1
        assert shown[:-1].isprintable(), "nothing that moves a cursor, and nothing that runs backwards"


@pytest.mark.parametrize("character", ["a", "é", "\U0001f600", "\0"])
def test_a_line_fits_whole_into_a_pipe(character):
    for length in (LONGEST_TEXT, 100 * LONGEST_TEXT):
        line = said("json", ServerEvent("refused", character * length, "r" * 40, "u" * 40))
        assert len(line) <= LONGEST_BYTES
        assert json.loads(line)["text"].startswith(character * 100)


def test_a_stream_that_was_closed_is_counted():
    stream = io.StringIO()
    lines = LogLines("text", stream)
    stream.close()
    lines.say("x")
    lines.say(JOINED)
    assert lines.lost == 2


SPEAKER = """
import sys
from cogrip.cli.serving.log_lines import LogLines
lines = LogLines(sys.argv[1])
for number in range(int(sys.argv[2])):
    lines.say(f"line {number}")
if len(sys.argv) == 3:
    print("the summary", flush=True)  # other prints there must not fail either
print(lines.lost, file=sys.stderr, flush=True)
"""


def lost(stdout: int, *arguments: object) -> int:
    """Let a process write so many lines; return how many it lost. It ends well."""
    command = [sys.executable, "-c", SPEAKER, *map(str, arguments)]
    done = subprocess.run(command, stdout=stdout, stderr=subprocess.PIPE, timeout=60.0, check=True)
    return int(done.stderr)


@pytest.mark.parametrize(("form", "pair"), [("text", os.pipe), ("json", os.pipe), ("text", pty.openpty)])
def test_a_closed_pipe_or_terminal_ends_nothing(form, pair):
    ours, its = pair()
    os.close(ours)
    assert lost(its, form, 10) == 10
    os.close(its)


def test_a_pipe_that_nobody_reads_holds_nothing_and_what_is_in_it_is_whole():
    ours, its = os.pipe()
    missing = lost(its, "text", 20_000, "no summary")
    os.close(its)
    with open(ours) as pipe:
        lines = pipe.read().splitlines()
    assert missing == 20_000 - len(lines) > 0
    assert lines == [f"line {number}" for number in range(len(lines))]


def test_a_terminal_that_is_held_holds_nothing():
    """Ctrl-S stops the log, and not the hands."""
    ours, its = pty.openpty()
    tty.setraw(its)
    assert lost(its, "text", 20_000, "no summary") > 0
    os.close(its)
    os.close(ours)
