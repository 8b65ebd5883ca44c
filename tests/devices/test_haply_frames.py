"""hAPI's bytes in both directions, and what is made of bytes that are no reply."""

import struct
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.haply.frames import HaplyCodec, reset_frame
from cogrip.devices.haply.models import MODELS

V3 = MODELS["2diy"].wiring
SETUP_V3 = bytes.fromhex("01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45")
TORQUES = bytes.fromhex("02 05 cd cc 4c 3d cd cc cc bc")
counts = st.integers(-20_000, 20_000)
noise = st.binary(max_size=40)


def reply(device_id: int, first: int, second: int, turn: float = 4880.0) -> bytes:
    """Compose a reply as the board does: ports 1 and 2, single precision."""
    return struct.pack("<Bff", device_id, 360.0 * first / turn, 360.0 * second / turn)


def test_frames_of_the_plastic_2diy_are_those_of_haplys_python_host() -> None:
    """The host states angles at setup; here the counters begin at zero."""
    assert reset_frame(0) == bytes.fromhex("00 00")
    begins_at_zero = SETUP_V3.replace(struct.pack("<f", 12.0), bytes(4)).replace(struct.pack("<f", 168.0), bytes(4))
    assert V3.setup(5) == begins_at_zero
    assert replace(V3, ports=(1, 2), ccw=(False, True)).setup(5)[2:8] == bytes((3, 0, 1, 3, 0, 1))


def test_commands_of_joints_become_torques_of_ports() -> None:
    assert HaplyCodec(V3, 5).encode((-2500, 5000, 7)) == TORQUES  # joint a is at port 2
    straight = replace(V3, ports=(1, 2))
    assert HaplyCodec(straight, 5).encode((5000, -2500, 7)) == TORQUES


@given(a=counts, b=counts, device_id=st.integers(1, 255), name=st.sampled_from(sorted(MODELS)))
def test_reply_gives_the_counts_back(a: int, b: int, device_id: int, name: str) -> None:
    wiring = MODELS[name].wiring
    codec = HaplyCodec(wiring, device_id)
    ports = (b, a) if wiring.ports == (2, 1) else (a, b)
    (reading,) = codec.feed(reply(device_id, *ports, wiring.counts_per_turn))
    assert reading.raw == (a, b, 0.0)
    assert codec.skipped == 0


@given(pairs=st.lists(st.tuples(counts, counts), min_size=1, max_size=4), cut=st.integers(1, 8))
def test_replies_at_once_and_one_in_two_parts_are_all_read_in_order(pairs: list[tuple[int, int]], cut: int) -> None:
    codec, data = HaplyCodec(V3, 7), b"".join(reply(7, *pair) for pair in pairs)
    assert codec.feed(data[:cut]) == []
    assert [reading.raw for reading in codec.feed(data[cut:])] == [(b, a, 0.0) for a, b in pairs]
    assert codec.skipped == 0


@given(chunks=st.lists(noise, max_size=6))
def test_noise_never_raises_and_is_counted_to_the_last_byte(chunks: list[bytes]) -> None:
    codec = HaplyCodec(V3, 7)
    readings = [reading for chunk in chunks for reading in codec.feed(chunk)]
    codec.reset()
    assert codec.skipped + codec.reply_bytes * len(readings) == sum(map(len, chunks))


@given(before=noise, a=counts, b=counts)
def test_after_a_reset_the_next_reply_is_read_whatever_came_before(before: bytes, a: int, b: int) -> None:
    codec = HaplyCodec(V3, 7)
    codec.feed(before)
    codec.reset()
    assert [reading.raw for reading in codec.feed(reply(7, a, b))] == [(b, a, 0.0)]


@pytest.mark.parametrize(
    "bad",
    [
        reply(8, 1, 2),  # of another device
        struct.pack("<Bff", 7, float("nan"), 0.0),
        struct.pack("<Bff", 7, 0.0, float("inf")),
        struct.pack("<Bff", 7, 0.0, 1e-30),  # less than a count
        struct.pack("<Bff", 7, 0.04, 0.0),  # half a count
        struct.pack("<Bff", 7, 7200.0 + 360.0, 0.0),
        reply(7, 1, 2)[1:] + b"\7",  # a byte too late
    ],
)
def test_what_no_counter_gives_is_dropped_with_what_stands_beside_it(bad: bytes) -> None:
    codec = HaplyCodec(V3, 7)
    assert codec.feed(bad + reply(7, 1, 2)) == []
    assert codec.skipped == 18
    assert len(codec.feed(reply(7, 1, 2))) == 1


def test_one_byte_answer_of_a_board_that_was_not_set_up_is_no_reply() -> None:
    codec = HaplyCodec(V3, 7)
    assert [codec.feed(b"\7") for _ in range(9)] == [[]] * 9
    codec.reset()
    assert codec.skipped == 9
