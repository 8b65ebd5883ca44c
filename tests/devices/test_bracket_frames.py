"""The bracket-ASCII frames, byte for byte in both directions, and what becomes of bytes that are none."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.arm.exchange import Reading
from cogrip.devices.serial.frames import ERRORS, LONGEST_REPLY, REJECTED, BracketCodec, error_text


def decode(data: bytes) -> Reading:
    [reading] = BracketCodec().feed(data)
    return reading


@pytest.mark.parametrize(
    ("commands", "frame"),
    [
        ((0, 0, 0), bytes.fromhex("5b302c302c305d0a0000000000000000")),
        ((6000, -6000, 1), b"[6000,-6000,1]\n\0"),
        ((6000, -6000, 10), b"[6000,-6000,10]\n"),
        ((6000, -6000, -10), b"[6000,-6000,-10]\n"),
        ((-6000, -6000, -6000), b"[-6000,-6000,-6000]\n"),
        ((0.9, -0.9, -1.9), b"[0,0,-1]\n\0\0\0\0\0\0\0"),
    ],
)
def test_a_request_is_filled_up_to_16_bytes_and_never_cut(commands, frame: bytes) -> None:
    assert BracketCodec().encode(commands) == frame


@pytest.mark.parametrize(
    ("data", "model", "raw", "gimbal"),
    [
        (b"[1,1,2,3,4,5,6,0]\n", "polhem", (1, 2, 3), (4, 5, 6)),
        (b"[1,1,2,3,4,5,6,0]\r\n", "polhem", (1, 2, 3), (4, 5, 6)),
        (b"[4,0,0,0,0,0,0,0]\n", "number 4", (0, 0, 0), (0, 0, 0)),
        (b"[0,-1,-0,007,0,0,0,0]\n", "number 0", (-1, 0, 7), (0, 0, 0)),
        (b"[2,-2147483648,2147483647,0,0,0,0,0]\n", "vintage", (-(2**31), 2**31 - 1, 0), (0, 0, 0)),
    ],
)
def test_other_good_replies(data: bytes, model: str, raw: tuple[int, ...], gimbal: tuple[int, ...]) -> None:
    assert decode(data) == Reading(raw, model=model, gimbal=gimbal)


@pytest.mark.parametrize(
    ("error", "text", "rejected"),
    [
        (0, "", False),
        (1, "gimbal sensor d cannot be read (error 1)", False),
        (2, "gimbal sensor e cannot be read (error 2)", False),
        (4, "gimbal sensor f cannot be read (error 4)", False),
        (5, "gimbal sensor d cannot be read, gimbal sensor f cannot be read (error 5)", False),
        (8, "stray characters after a frame (error 8)", True),
        (9, "unknown (error 9)", True),
        (128, "no end of frame within 127 bytes (error 128)", True),
        (256, "end of frame before its start (error 256)", True),
        (512, "not two commas (error 512)", True),
        (1024, "not three integers (error 1024)", True),
        (2048, "unknown (error 2048)", True),
        (-1, "unknown (error -1)", True),
    ],
)
def test_errors_of_the_firmware(error: int, text: str, rejected: bool) -> None:
    reading = decode(b"[2,0,0,0,0,0,0,%d]\n" % error)
    assert (reading.error, reading.rejected) == (text, rejected)
    assert not error or error_text(error) == text
    assert REJECTED == 8 == min(number for number in ERRORS if number > 4)


NO_REPLIES = (  # seven numbers, nine; signs, blanks, brackets and digits that the firmware does not write
    b"[2,1,2,3,4,5,6]\n", b"[2,1,2,3,4,5,6,0,0]\n", b"[2,1,2,3,4,5,6,0]\0", b"[2,1,2,3,4,5,6,0]\r\r\n", b"[2,1,2,3,4,5,6,]\n",
    b"[2, 1,2,3,4,5,6,0]\n", b"[2,+1,2,3,4,5,6,0]\n", b"[2,1.0,2,3,4,5,6,0]\n", b"[2,--1,2,3,4,5,6,0]\n", b"[2,1,2,3,4,5,6,0\n",
    b"2,1,2,3,4,5,6,0]\n", b"(2,1,2,3,4,5,6,0)\n", b"[2,12345678901,2,3,4,5,6,0]\n", "[2,\u0661,2,3,4,5,6,0]\n".encode(),
    b"[]\n", b"\n",
)  # fmt: skip


@pytest.mark.parametrize("data", NO_REPLIES)
def test_what_is_no_reply_is_skipped_and_counted(data: bytes) -> None:
    codec = BracketCodec()
    assert codec.feed(data) == []
    codec.reset()
    assert codec.skipped == len(data)
    assert codec.feed(b"[2,1,2,3,4,5,6,0]\n") == [Reading((1, 2, 3), model="vintage", gimbal=(4, 5, 6))]
    assert codec.skipped == len(data)


@pytest.mark.parametrize("noise", [b"x", b"[", b"[2,1,", b"[[[", b"]\n", b"[2,1,2,3,4,5,6,0]", b"\xff\0[9", b"\n\n"])
def test_it_finds_its_place_again_at_the_next_bracket(noise: bytes) -> None:
    codec = BracketCodec()
    assert [one.raw for one in codec.feed(noise + b"[2,1,2,3,4,5,6,0]\n")] == [(1, 2, 3)]
    assert codec.skipped == len(noise)


def test_a_part_is_kept_until_it_is_too_long() -> None:
    codec = BracketCodec()
    codec.feed(b"[" + b"1" * (LONGEST_REPLY - 2))
    assert codec.skipped == 0
    codec.feed(b"1")
    assert codec.skipped == LONGEST_REPLY
    codec.feed(b"1" * 1000)
    assert codec.skipped == LONGEST_REPLY + 1000


NUMBERS = st.integers(-(2**31), 2**31 - 1)
REPLIES = st.tuples(st.integers(1, 3), *[NUMBERS] * 6, st.sampled_from((0, *ERRORS)))
FRAMES = REPLIES.map(lambda numbers: b"[" + b",".join(b"%d" % number for number in numbers) + b"]\n")
GARBAGE = st.one_of(st.binary(max_size=40), st.text("[],-0123456789\r\n\0", max_size=60).map(str.encode))


@given(st.lists(st.one_of(FRAMES, GARBAGE), max_size=8), st.data())
def test_however_it_comes_the_whole_replies_are_found(parts: list[bytes], data: st.DataObject) -> None:
    """Any split gives the same, in the same order; every other byte is counted; nothing is raised."""
    stream = b"".join(parts)
    whole, pieces = BracketCodec(), BracketCodec()
    expected = whole.feed(stream)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    pairs = zip([0, *cuts], [*cuts, len(stream)], strict=True)
    assert [one for begin, end in pairs for one in pieces.feed(stream[begin:end])] == expected
    for codec in (whole, pieces):
        codec.reset()
    assert whole.skipped == pieces.skipped
    assert 0 <= whole.skipped <= len(stream)


@given(st.lists(FRAMES, min_size=1, max_size=5), st.lists(GARBAGE, min_size=6, max_size=6))
def test_good_replies_in_garbage_are_all_found(frames: list[bytes], garbage: list[bytes]) -> None:
    """Garbage without a bracket cannot swallow one: a reply begins at its own."""
    garbage = [part.replace(b"]", b"") for part in garbage]
    stream = b"".join(noise + frame for noise, frame in zip(garbage, frames, strict=False))
    codec = BracketCodec()
    found = codec.feed(stream)
    assert [one.raw for one in found] == [tuple(map(int, frame[1:-2].split(b",")))[1:4] for frame in frames]
    codec.reset()
    assert codec.skipped == len(stream) - sum(map(len, frames))
