"""The pacer on a fake clock: exact deadlines, the sleep and the spin, both sides of the overrun boundary."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.machine.pacing import Pacer

T0_NS = 5_000_000_000
READ_NS = 10  # what one reading of the fake clock costs


class FakeClock:
    """Time that passes by reading it and by sleeping on it; a sleep ends `oversleep_ns` late, lasts half at least."""

    def __init__(self, now_ns: int = T0_NS) -> None:
        self.now_ns = now_ns
        self.oversleep_ns = 0
        self.slept_ns: list[int] = []

    def __call__(self) -> int:
        self.now_ns += READ_NS
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        asked_ns = round(seconds * 1e9)
        self.slept_ns.append(asked_ns)
        self.now_ns += max(asked_ns // 2, asked_ns + self.oversleep_ns)


def paced(clock: FakeClock, rate_hz: int = 1000, spin_ns: int = 50_000, first: int = 0) -> Pacer:
    return Pacer(rate_hz, T0_NS, first=first, spin_ns=spin_ns, clock=clock, sleep=clock.sleep)


@given(st.sampled_from([1, 7, 128, 1000, 1024, 4096, 8192]), st.integers(0, 10**10), st.integers(-3, 3))
def test_tick_at_inverts_due(rate_hz: int, tick: int, offset_ns: int) -> None:
    pacer = Pacer(rate_hz, T0_NS)
    now_ns = pacer.due_ns(tick) + offset_ns
    newest = pacer.tick_at(now_ns)
    assert pacer.due_ns(newest) <= now_ns < pacer.due_ns(newest + 1)


def test_every_tick_runs_in_order_within_a_clock_reading() -> None:
    clock = FakeClock(T0_NS - 3_000_000)
    pacer = paced(clock, 1024, spin_ns=1_000)
    for tick in range(3000):
        assert pacer.wait() == tick
        assert 0 <= pacer.late_ns <= READ_NS
        assert pacer.next_due_ns == pacer.due_ns(tick + 1)
    assert (pacer.due, pacer.run, pacer.skipped) == (3000, 3000, 0)
    assert pacer.lateness.count == 3000
    assert pacer.lateness.max_ns <= READ_NS


@pytest.mark.parametrize(
    ("rate_hz", "spin_ns"), [(1000, 60_000), (1024, 60_000), (4096, 60_000), (8192, 30_517), (20_000, 12_500)]
)
def test_sleeps_to_the_spin_and_spins_the_rest_which_is_no_more_than_a_part(rate_hz: int, spin_ns: int) -> None:
    """The rest is left to those of lower priority: its server, its recorder."""
    clock = FakeClock(T0_NS)
    pacer = paced(clock, rate_hz, spin_ns=60_000, first=1)
    assert pacer.spin_ns == spin_ns
    pacer.wait()
    assert clock.slept_ns == [pytest.approx(1e9 / rate_hz - READ_NS - spin_ns, abs=1)]
    assert 0 <= clock.now_ns - pacer.due_ns(1) <= READ_NS


@pytest.mark.parametrize(
    ("oversleep_ns", "least_ns", "again"), [(-200_000, 0, True), (40_000, 0, False), (80_000, 30_000, False)]
)
def test_an_early_wake_sleeps_again_and_an_oversleep_is_late_by_what_is_beyond_the_spin(
    oversleep_ns: int, least_ns: int, again: bool
) -> None:
    clock = FakeClock(T0_NS)
    clock.oversleep_ns = oversleep_ns
    pacer = paced(clock, first=1)
    pacer.wait()
    assert (len(clock.slept_ns) > 1) is again
    assert least_ns <= pacer.late_ns <= least_ns + READ_NS


def test_exactly_one_period_late_runs_both_ticks_and_one_nanosecond_more_skips_to_the_newest() -> None:
    for beyond_ns, ticks, late_ns, counts in ((0, [0, 1], [1_000_000, READ_NS], (2, 2, 0)), (1, [1], [1], (2, 1, 1))):
        clock = FakeClock()
        pacer = paced(clock)
        clock.now_ns = pacer.due_ns(1) - READ_NS + beyond_ns
        assert [(pacer.wait(), pacer.late_ns) for _ in ticks] == list(zip(ticks, late_ns, strict=True))
        assert (pacer.due, pacer.run, pacer.skipped) == counts
        assert pacer.lateness.max_ns == 1_000_000 + beyond_ns, "lateness counts from the deadline that was missed"
        assert clock.slept_ns == []


@given(st.sampled_from([128, 1024, 8192]), st.lists(st.integers(0, 30_000_000), max_size=60), st.integers(0, 100_000))
def test_ticks_rise_and_none_is_lost_from_the_count(rate_hz: int, works_ns: list[int], spin_ns: int) -> None:
    clock = FakeClock()
    pacer = paced(clock, rate_hz, max(spin_ns - spin_ns % READ_NS, 0) // 100, first=3)
    ticks = []
    for work_ns in works_ns:
        ticks.append(pacer.wait())
        assert pacer.due_ns(ticks[-1]) <= clock.now_ns
        assert pacer.late_ns <= 1_000_000_000 // rate_hz + 1
        clock.now_ns += work_ns
        pacer.done()
    assert ticks == sorted(set(ticks))
    assert pacer.due == (ticks[-1] - 3 + 1 if ticks else 0)
    assert pacer.run == len(ticks) == pacer.work.count


@pytest.mark.parametrize("ahead_ns", [0, 456_000])
def test_work_is_from_the_ticks_start_to_the_first_done_and_what_was_done_ahead(ahead_ns: int) -> None:
    clock = FakeClock()
    pacer = paced(clock)
    pacer.done()
    pacer.wait()
    clock.now_ns += 123_000
    pacer.done(ahead_ns)
    pacer.done()
    assert pacer.work.count == 1
    assert pacer.work.max_ns == 123_000 + ahead_ns + READ_NS


def test_two_rooms_take_turns_in_one_thread() -> None:
    rooms = [Pacer(128, T0_NS), Pacer(100, T0_NS + 1_000_000)]
    assert rooms[0].take(T0_NS - 1) is None
    now_ns, ran = T0_NS, [0, 0]
    while now_ns < T0_NS + 10**9:
        for index, room in enumerate(rooms):
            if room.take(now_ns) is not None:
                ran[index] += 1
        now_ns = min(room.next_due_ns for room in rooms)
    assert ran == [128, 100]
    assert all(room.skipped == 0 and room.lateness.max_ns == 0 for room in rooms)


@pytest.mark.parametrize(("rate_hz", "spin_ns"), [(0, 0), (-1, 0), (1000, -1)])
def test_impossible_settings_are_refused(rate_hz: int, spin_ns: int) -> None:
    with pytest.raises(ValueError, match=r"rate_hz|spin_ns"):
        Pacer(rate_hz, T0_NS, spin_ns=spin_ns)
