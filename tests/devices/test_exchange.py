"""Requests and replies in lock-step, over a wire that keeps the order and does whatever else it likes. Virtual time."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.devices.arm.exchange import RequestExchange, meet
from cogrip.devices.device import DeviceError
from cogrip.devices.serial.frames import BracketCodec

RATE_HZ = 1000
RETRY = 5  # ticks, at this rate
ZERO = (0, 0, 0)


class Wire:
    """A port and the device at its other end. Each request has one reply, that says its number; it comes when `delay` says.

    delay: of each request in turn [ticks], the last one for all that follow; None: it is lost.
    """

    def __init__(self, delay: Sequence[float | None] = (0.1,)) -> None:
        self.name = "wire:test"
        self.counts: dict[str, int] = {}
        self.delay = list(delay)
        self.now = 0.0
        self.asked: list[int] = []  # the tick of each request
        self.waits: list[float] = []
        self.coming: list[tuple[float, bytes]] = []

    def open(self) -> None:
        """Nothing to open."""

    def close(self) -> None:
        """Nor to close."""

    def stamp(self) -> str:
        return "once"

    def write(self, frame: bytes) -> None:
        assert frame.startswith(b"[")
        number = len(self.asked)
        self.asked.append(round(self.now))
        delay = self.delay[min(number, len(self.delay) - 1)]
        if delay is not None:
            self.send(b"[2,%d,0,0,0,0,0,0]\n" % number, delay)

    def send(self, data: bytes, delay: float = 0.0) -> None:
        """Nothing overtakes what was sent before."""
        self.coming.append((max(self.now + delay, *[at for at, _ in self.coming], self.now), data))

    def read(self, wait_s: float = 0.0) -> bytes:
        self.waits.append(wait_s)
        until = self.now + wait_s * RATE_HZ
        here = [data for at, data in self.coming if at <= until]
        del self.coming[: len(here)]
        return b"".join(here)


def exchange(*delay: float | None) -> tuple[RequestExchange, Wire]:
    wire = Wire(delay or (0.1,))
    made = RequestExchange(wire, BracketCodec())
    made.start(RATE_HZ)
    return made, wire


def run(made: RequestExchange, wire: Wire, ticks: int) -> list[tuple[int, int, int] | None]:
    """Per tick: (tick, number of the request that was answered, age), or None."""
    found = []
    for tick in range(round(wire.now), round(wire.now) + ticks):
        wire.now = tick
        answer = made.reply(tick)
        found.append(None if answer is None else (tick, round(answer[0].raw[0]), answer[1]))
        made.ask(ZERO, tick)
    wire.now += 1
    return found


def true_age(wire: Wire, found: tuple[int, int, int]) -> bool:
    tick, number, age = found
    return wire.asked[number] == tick - age


def test_one_request_and_one_reply_a_tick() -> None:
    made, wire = exchange()
    assert run(made, wire, 20) == [None, *[(tick, tick - 1, 1) for tick in range(1, 20)]]
    assert wire.asked == list(range(20))
    assert made.counts == {}


def test_nothing_is_read_before_something_was_asked_nor_after_a_new_start() -> None:
    made, wire = exchange(None)
    wire.send(b"[2,9,9,9,0,0,0,0]\n")
    assert made.reply(0) is None
    assert wire.waits == []
    run(made, wire, 8)
    made.start(RATE_HZ)
    assert made.reply(8) is None
    assert made.ask(ZERO, 8)


def test_a_reply_that_is_not_there_is_waited_for_a_quarter_of_a_tick() -> None:
    made, wire = exchange(1.2)
    assert [answer and answer[2] for answer in run(made, wire, 8)] == [None, 1, 1, 1, 1, 1, 1, 1]
    assert set(wire.waits) == {0.25 / RATE_HZ}
    made, wire = exchange(1.3)
    assert [answer and answer[2] for answer in run(made, wire, 8)] == [None, None, 2, None, 2, None, 2, None]
    assert made.counts == {"reply late": 4, "request held back": 4}


def test_a_second_request_waits_for_the_reply() -> None:
    made, wire = exchange(3.0, 0.1)
    assert run(made, wire, 4) == [None, None, None, (3, 0, 3)]
    assert wire.asked == [0, 3]
    assert made.counts == {"reply late": 2, "request held back": 2}


@pytest.mark.parametrize("rate_hz", [100, 200, 1000, 1024, 4000])
def test_a_request_is_repeated_after_five_milliseconds(rate_hz: int) -> None:
    made, wire = exchange(None)
    made.start(rate_hz)
    retry = max(1, round(0.005 * rate_hz))
    assert not any(run(made, wire, 3 * retry + 1))
    assert wire.asked == [0, retry, 2 * retry, 3 * retry]
    assert made.counts["reply missed"] == 3


def test_a_lost_reply_costs_ten_milliseconds_and_its_sample_is_as_old_as_it_says() -> None:
    """The reply to the second request may be the first one's: it is kept for as long as another one may come."""
    made, wire = exchange(None, 0.1)
    found = [answer for answer in run(made, wire, 30) if answer]
    assert found[0] == (11, 1, 6)
    assert found[1:] == [(tick, tick - 10, 1) for tick in range(12, 30)]
    assert made.counts == {"reply late": 10, "reply missed": 1, "request held back": 9}


@pytest.mark.parametrize(("late", "usual", "age"), [(5.7, 0.9, 1), (6.5, 1.5, 2)])
def test_a_late_reply_is_not_taken_for_the_next_one(late: float, usual: float, age: int) -> None:
    """It is on its way still when it is repeated at 5; where the others take a tick and a half, each would look like half."""
    made, wire = exchange(late, usual)
    found = [answer for answer in run(made, wire, 60) if answer]
    assert all(true_age(wire, answer) for answer in found)
    assert {each for _, _, each in found[1:]} == {age}
    if age == 1:
        assert found[0] == (6, 1, 1)
        assert made.counts["reply too many"] == 1


@pytest.mark.parametrize("extra", [1, 2, 5])
def test_of_several_replies_the_newest_counts(extra: int) -> None:
    made, wire = exchange()
    run(made, wire, 5)
    for _ in range(extra):
        wire.send(b"[2,77,0,0,0,0,0,0]\n")
    wire.send(b"[2,99,0,0,0,0,0,0]\n")
    assert run(made, wire, 1) == [(5, 99, 1)]
    assert made.counts == {"reply too many": extra + 1}
    assert run(made, wire, 2) == [(6, 5, 1), (7, 6, 1)]


def test_a_reply_in_two_parts_is_waited_for_twice_and_then_put_together() -> None:
    made, wire = exchange(None)
    made.ask(ZERO, 0)
    wire.send(b"[2,5,0,0,0,", 0.5)
    wire.send(b"0,0,0]\n", 1.5)
    wire.now = 1
    assert made.reply(1) is None
    assert len(wire.waits) == 2
    wire.now = 2
    reading, age = made.reply(2)  # type: ignore[misc]
    assert (reading.raw, age) == ((5, 0, 0), 2)
    assert made.counts == {"reply in parts": 1, "reply late": 1}


def test_half_a_reply_is_dropped_when_it_is_asked_anew() -> None:
    made, wire = exchange(None, 0.1)
    made.ask(ZERO, 0)
    wire.send(b"[2,5,0,0,0,", 0.5)
    assert next(answer for answer in run(made, wire, 20) if answer)[1] == 1
    assert made.counts["bytes skipped"] == 11


def test_garbage_is_counted_and_is_no_reply() -> None:
    made, wire = exchange(None)
    made.ask(ZERO, 0)
    for tick in range(1, 6):
        wire.now = tick
        wire.send(b"garbage")
        assert made.reply(tick) is None
    assert made.counts == {"reply in parts": 5, "bytes skipped": 35, "reply late": 5, "reply missed": 1}


def test_a_jump_of_the_ticks_makes_the_reply_as_old_as_it_is() -> None:
    made, wire = exchange()
    run(made, wire, 3)
    wire.now = 40
    assert run(made, wire, 1) == [(40, 2, 38)]
    assert made.reply(41)[1] == 1  # type: ignore[index]
    assert made.reply(41) is None


DELAYS = st.lists(st.one_of(st.floats(0.0, 12.0), st.none()), max_size=30)


@given(DELAYS, st.floats(0.0, 1.2))
def test_whatever_the_wire_does_it_keeps_step_and_heals(delays: list[float | None], usual: float) -> None:
    """A second request only after a reply or five ticks; ages never run backwards; 25 ticks later all is as ever."""
    made, wire = exchange(*delays, usual)
    disturbed = len(delays) * 2 * (RETRY + 12) + 2 * RETRY
    found = run(made, wire, disturbed)
    answered = {answer[0] for answer in found if answer}
    for before, after in zip(wire.asked, wire.asked[1:], strict=False):
        assert after - before >= RETRY or any(before < tick <= after for tick in answered)
    taken = [tick - age for answer in found if answer for tick, _, age in [answer]]
    assert taken == sorted(set(taken))
    numbers = [answer[1] for answer in found if answer]
    assert numbers == sorted(set(numbers))
    run(made, wire, 25)
    before = dict(made.counts)
    last = [answer for answer in run(made, wire, 10) if answer]
    assert len(last) == 10
    assert all(true_age(wire, answer) and answer[2] == 1 for answer in last)
    assert made.counts == before


@given(st.lists(st.floats(0.0, 4.9), max_size=60))
def test_where_no_reply_is_five_ticks_late_every_age_is_the_true_one(delays: list[float]) -> None:
    made, wire = exchange(*delays, 0.1)
    found = [answer for answer in run(made, wire, 200) if answer]
    assert all(true_age(wire, answer) for answer in found)
    assert "reply missed" not in made.counts
    assert "reply too many" not in made.counts


@given(st.lists(st.floats(0.0, 9.0), max_size=40))
def test_late_replies_that_come_within_five_ticks_of_each_other_are_told_apart(delays: list[float]) -> None:
    """Replies come as on a wire that grows no slower."""
    made, wire = exchange(*sorted(delays, reverse=True), 0.1)
    found = [answer for answer in run(made, wire, 400) if answer]
    assert all(true_age(wire, answer) for answer in found)


@pytest.mark.parametrize(
    ("delay", "sent", "at", "met"),
    [
        ((0.1,), b"[2,9,9,9,0,0,0,0]\n[2,8", 0.0, 0),  # from before
        ((None, None, 0.1), b"", 0.0, 2),
        ((None, 0.1), b"[2,7,7,7,0,0,0,512]\n", 1.0, 1),  # half a request of another program stood before ours
    ],
)
def test_it_meets_a_device_that_answers(delay: tuple[float | None, ...], sent: bytes, at: float, met: int) -> None:
    wire = Wire(delay)
    wire.send(sent, at)
    assert meet(RequestExchange(wire, BracketCodec()), ZERO).raw == (met, 0, 0)
    assert wire.read() == b"", "it leaves nothing behind"


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (b"[2,7,7,7,0,0,0,512]\n", r"wire:test: refuses every request: not two commas \(error 512\)"),
        (b"", r"wire:test: no reply to 10 requests in 1 s; is this the right port"),
    ],
)
def test_a_device_that_refuses_everything_or_is_silent_is_not_met(answer: bytes, said: str) -> None:
    wire, asked = Wire([None]), []
    wire.write = lambda frame: (asked.append(frame), wire.send(answer, 1.0))  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match=said):
        meet(RequestExchange(wire, BracketCodec()), ZERO)
    assert len(asked) == 10


def test_a_device_that_never_stops_talking_is_another_one() -> None:
    wire = Wire()
    wire.read = lambda wait_s=0.0: b"$GPGGA,"  # type: ignore[method-assign]
    with pytest.raises(DeviceError, match="sends without being asked"):
        meet(RequestExchange(wire, BracketCodec()), ZERO)
