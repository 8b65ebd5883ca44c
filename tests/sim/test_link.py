"""The link emulator: exact delay, the statistics it promises, paired fates, conservation, outages."""

import math
from itertools import groupby, islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.protocol.settings.link_profile import LinkProfile as Profile
from cogrip.sim import link
from cogrip.sim.link import LinkEmulator, fates
from cogrip.sim.outages import NEVER_NS, Outages

MS, S = 1_000_000, 1_000_000_000
ROUGH = Profile(delay_ms=40, jitter_ms=20, loss=0.3, burst_frames=4, duplicate=0.1, reorder=0.1, rate_kbps=400)

profiles = st.builds(
    Profile,
    delay_ms=st.floats(0, 500),
    jitter_ms=st.sampled_from([0.0, 1.0, 50.0]),
    loss=st.sampled_from([0.0, 0.01, 0.3, 0.7]),
    burst_frames=st.sampled_from([1.0, 4.0, 10.0]),
    duplicate=st.sampled_from([0.0, 0.2, 1.0]),
    reorder=st.sampled_from([0.0, 0.2, 1.0]),
    rate_kbps=st.sampled_from([0.0, 5.0, 100.0]),
    outage_s=st.just(0.1),
    outage_every_s=st.sampled_from([0.15, 1e5]),
)

PINNED = [
    (True, 0, None, False),
    (False, 17228124, None, False),
    (False, 32857921, 7491973, True),
    (True, 0, None, False),
    (True, 0, None, False),
]


def lost_runs(profile: Profile, count: int, seed: str = "runs") -> tuple[float, float]:
    """Return the rate of loss and the mean length of a run of losses."""
    lost = [fate.lost for fate in islice(fates(profile, seed), count)]
    runs = [sum(1 for _ in run) for value, run in groupby(lost) if value]
    return sum(lost) / count, sum(runs) / max(1, len(runs))


def arrivals(link: LinkEmulator) -> list[tuple[int, bytes]]:
    """Return (time, datagram) of all that is under way."""
    found = []
    while (next_ns := link.next_ns) is not None:
        came = link.due(next_ns)
        assert came, "next_ns is when something arrives"
        found += [(next_ns, payload) for payload in came]
    return found


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("loss", "burst", "expected_run"),
    [
        (0.3, 4.0, 4.0),
        (0.05, 10.0, 10.0),
        (0.5, 2.0, 2.0),
        (0.3, 1.0, 1 / 0.7),
        (0.7, 1.0, 1 / 0.3),
        (0.3, 1 / 0.7, 1 / 0.7),
    ],
)
def test_gilbert_elliott_keeps_its_rate_and_its_bursts(loss: float, burst: float, expected_run: float) -> None:
    rate, run = lost_runs(Profile(loss=loss, burst_frames=burst), 200_000)
    assert rate == pytest.approx(loss, rel=0.05)
    assert run == pytest.approx(expected_run, rel=0.05)


def test_the_first_datagram_is_as_likely_lost_as_any() -> None:
    profile = Profile(loss=0.3, burst_frames=20)
    first = [next(fates(profile, f"seed {index}")).lost for index in range(4000)]
    assert sum(first) / 4000 == pytest.approx(0.3, abs=0.03)


def test_jitter_is_gamma_of_shape_two() -> None:
    extra_ms = np.array([fate.extra_ns for fate in islice(fates(Profile(jitter_ms=20), "gamma"), 200_000)]) / 1e6
    assert extra_ms.min() >= 0
    assert extra_ms.mean() == pytest.approx(20, rel=0.01)
    assert extra_ms.var() == pytest.approx(20**2 / 2, rel=0.03)
    centred = (extra_ms - extra_ms.mean()) / extra_ms.std()
    assert (centred**3).mean() == pytest.approx(math.sqrt(2), rel=0.06)


@given(st.floats(0, 10_000), st.integers(0, 10**15))
def test_delay_is_exact(delay_ms: float, sent_ns: int) -> None:
    emulator = LinkEmulator(Profile(delay_ms=delay_ms), "exact")
    emulator.send(b"x", sent_ns)
    arrival_ns = sent_ns + round(delay_ms * 1e6)
    assert emulator.next_ns == arrival_ns
    assert emulator.due(arrival_ns - 1) == []
    assert emulator.due(arrival_ns) == [b"x"]
    assert emulator.next_ns is None


def test_ties_arrive_in_the_order_of_sending() -> None:
    emulator = LinkEmulator(Profile(delay_ms=5), "ties")
    payloads = [bytes([255 - index]) for index in range(20)]
    for payload in payloads:
        emulator.send(payload, 0)
    assert emulator.due(5 * MS) == payloads
    assert emulator.reordered == 0


@given(profiles, st.lists(st.tuples(st.integers(0, 20 * MS), st.integers(1, 1200)), max_size=80), st.data())
def test_nothing_appears_or_vanishes_and_the_calls_of_due_change_nothing(
    profile: Profile, sends: list[tuple[int, int]], data: st.DataObject
) -> None:
    often, once = LinkEmulator(profile, "conserve"), LinkEmulator(profile, "conserve")
    now_ns, got = 0, []
    for index, (gap_ns, size) in enumerate(sends):
        now_ns += gap_ns
        payload = index.to_bytes(2, "big") + bytes(size)
        often.send(payload, now_ns)
        once.send(payload, now_ns)
        if data.draw(st.booleans()):
            got += often.due(now_ns)
        for each in (often, once):
            gone = each.lost + each.queue_dropped + each.outage
            assert each.delivered - each.duplicated + gone + each.in_flight == each.sent == index + 1
    end_ns = now_ns + 10**12
    got += often.due(end_ns)
    assert got == once.due(end_ns)
    assert often.counters == once.counters
    assert often.in_flight == 0
    assert often.delivered == len(got)


def test_a_fate_depends_on_the_seed_and_the_number_only() -> None:
    one, other = LinkEmulator(ROUGH, "a"), LinkEmulator(replace(ROUGH, rate_kbps=0), "a")
    expected = list(islice(fates(ROUGH, "a"), 500))
    assert expected == list(islice(fates(ROUGH, "a"), 500))
    assert expected != list(islice(fates(ROUGH, "b"), 500))
    for index in range(500):
        one.send(bytes(index % 7), index * 8 * MS)
        other.send(b"another payload altogether", index * 3 * MS)
    assert one.queue_dropped == 0
    for each in (one, other):
        assert each.lost == sum(fate.lost for fate in expected)
        assert each.duplicated == sum(fate.copy_extra_ns is not None for fate in expected)
        assert each.held == sum(fate.held for fate in expected)


def test_fates_are_pinned() -> None:
    """A recorded experiment must find its link again: these numbers may never change."""
    assert [tuple(fate) for fate in islice(fates(ROUGH, "pinned 110"), 5)] == PINNED


@pytest.mark.parametrize("changed", [{"loss": 0.0}, {"duplicate": 0.9}, {"reorder": 0.0}, {"delay_ms": 1.0}])
def test_impairments_draw_from_streams_of_their_own(changed: dict[str, float]) -> None:
    before = list(islice(fates(ROUGH, "paired"), 2000))
    after = list(islice(fates(replace(ROUGH, **changed), "paired"), 2000))
    both = [(one, other) for one, other in zip(before, after, strict=True) if not one.lost and not other.lost]
    assert len(both) > 1000
    for one, other in both:
        if not one.held and not other.held:
            assert one.extra_ns == other.extra_ns
    if "loss" not in changed:
        assert [fate.lost for fate in before] == [fate.lost for fate in after]


@pytest.mark.parametrize("origin_ns", [None, 5_000 * MS])
def test_an_outage_takes_what_is_sent_in_it_and_leaves_every_other_fate_alone(origin_ns: int | None) -> None:
    whole = LinkEmulator(ROUGH, "paired")
    down = LinkEmulator(replace(ROUGH, outage_s=0.1, outage_every_s=0.5), "paired", [(0.25, 0.05)], origin_ns=origin_ns)
    begin_ns, spared = 5_000 * MS, []
    for index in range(500):
        now_ns = begin_ns + index * 8 * MS
        payload = index.to_bytes(2, "big")
        elapsed_ns = now_ns - begin_ns
        periodic = elapsed_ns >= 500 * MS and elapsed_ns % (500 * MS) < 100 * MS
        if not periodic and not 250 * MS <= elapsed_ns < 300 * MS:
            spared.append(payload)
        whole.send(payload, now_ns)
        down.send(payload, now_ns)
        assert down.sent + down.duplicated == down.lost + down.outage + down.queue_dropped + down.in_flight
    assert down.outage == 500 - len(spared) > 90
    assert whole.queue_dropped == down.queue_dropped == 0

    assert arrivals(down) == [each for each in arrivals(whole) if each[1] in spared]


def test_an_outage_keeps_a_bottleneck_free() -> None:
    emulator = LinkEmulator(Profile(rate_kbps=80, outage_s=0.1, outage_every_s=1.0), "free")
    emulator.send(bytes(72), 0)
    emulator.send(bytes(72), 1000 * MS)
    emulator.send(bytes(72), 1100 * MS)
    emulator.due(1109 * MS)
    assert (emulator.delivered, emulator.outage, emulator.next_ns) == (1, 1, 1110 * MS)


def test_duplicates_have_jitter_of_their_own() -> None:
    drawn = list(islice(fates(Profile(jitter_ms=20, duplicate=0.25), "copies"), 40_000))
    copies = [(fate.extra_ns, fate.copy_extra_ns) for fate in drawn if fate.copy_extra_ns is not None]
    assert len(copies) / len(drawn) == pytest.approx(0.25, rel=0.05)
    pairs = np.array(copies, dtype=float)
    assert pairs[:, 1].mean() == pytest.approx(20 * MS, rel=0.05)
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.05


def test_held_datagrams_are_overtaken() -> None:
    emulator = LinkEmulator(Profile(delay_ms=10, reorder=0.1), "hold")
    drawn = list(islice(fates(Profile(reorder=0.1), "hold"), 5000))
    held_ms = [fate.extra_ns / MS for fate in drawn if fate.held]
    assert len(held_ms) / 5000 == pytest.approx(0.1, rel=0.15)
    assert min(held_ms) >= link.HOLD_MS[0]
    assert max(held_ms) <= link.HOLD_MS[1]
    for index in range(5000):
        emulator.send(b"", index * 2 * MS)
    emulator.due(10**12)
    assert emulator.held == len(held_ms)
    assert emulator.reordered >= 0.95 * emulator.held


def test_the_bottleneck_spaces_datagrams_by_their_size() -> None:
    emulator = LinkEmulator(Profile(delay_ms=7, rate_kbps=80), "rate")
    for _ in range(3):
        emulator.send(bytes(72), 0)  # 100 bytes with headers: 10 ms at 80 kbit/s
    emulator.send(bytes(72), 1000 * MS)
    assert [arrival_ns for arrival_ns, _ in arrivals(emulator)] == [17 * MS, 27 * MS, 37 * MS, 1017 * MS]


def test_the_queue_holds_half_a_second_and_not_more() -> None:
    emulator = LinkEmulator(Profile(rate_kbps=80), "queue")
    for _ in range(60):
        emulator.send(bytes(72), 0)
    assert emulator.queue_dropped == 60 - 51, "one on the wire and 50 that wait at most 500 ms"
    emulator.send(bytes(72), 10 * MS - 1)
    assert emulator.queue_dropped == 10
    emulator.send(bytes(72), 10 * MS)
    assert emulator.queue_dropped == 10


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"loss": 1.0}, "loss = 1.0"),
        ({"loss": -0.1}, "loss"),
        ({"loss": math.nan}, "loss"),
        ({"loss": 0.5, "burst_frames": 1.9}, "burst_frames = 1.9 .* at least 2"),
        ({"burst_frames": 0.5}, "burst_frames"),
        ({"burst_frames": math.inf}, "burst_frames"),
        ({"duplicate": 1.1}, "duplicate"),
        ({"reorder": -1.0}, "reorder"),
        ({"delay_ms": -1.0}, "delay_ms"),
        ({"jitter_ms": math.nan}, "jitter_ms"),
        ({"rate_kbps": math.inf}, "rate_kbps"),
    ],
)
def test_an_impossible_link_is_refused(changed: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LinkEmulator(replace(Profile(), **changed), "never")


# Outages

scripts = st.lists(st.tuples(st.floats(0, 50), st.floats(0.001, 10)), max_size=6)
periodic = st.sampled_from([(0.0, 0.0), (0.5, 3.0), (2.9, 3.0), (1e-9, 1.0)])


def test_the_first_periodic_outage_comes_after_one_period_and_lasts_its_length() -> None:
    outages = Outages(0.5, 3.0)
    for k in (1, 2, 1000):
        begin = 3 * k * S
        assert [outages.down_at(begin + each) for each in (-1, 0, S // 2 - 1, S // 2)] == [False, True, True, False]
    assert not any(outages.down_at(each) for each in (-S, 0, 1, S // 2))


def test_scripted_outages_join_where_they_touch_and_need_no_order() -> None:
    outages = Outages(script=[(2.0, 1.0), (1.0, 1.0), (1.5, 0.2)])
    assert [outages.down_at(each) for each in (S - 1, S, 2 * S - 1, 2 * S, 3 * S - 1, 3 * S)] == [
        False, True, True, True, True, False,
    ]  # fmt: skip
    assert outages.next_begin_ns(0) == S
    assert outages.next_begin_ns(S) == NEVER_NS, "they are one"


@given(periodic, scripts, st.integers(0, 70 * S))
def test_nothing_begins_before_the_next_begin(every: tuple[float, float], script: list, at_ns: int) -> None:
    outages = Outages(*every, script)
    assert bool(outages) is bool(every[0] or script)
    begin_ns = outages.next_begin_ns(at_ns)
    assert begin_ns > at_ns
    if begin_ns == NEVER_NS:
        assert not every[0]
        assert not any(outages.down_at(each) for each in (200 * S, 201 * S))
        return
    assert outages.down_at(begin_ns)
    if not outages.down_at(at_ns):
        for part in range(1, 20):
            between_ns = at_ns + (begin_ns - at_ns) * part // 20
            assert between_ns == begin_ns or not outages.down_at(between_ns)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.5,), "outage_s = 0.5 must be above 0 and below outage_every_s = 0.0"),
        ((3.0, 3.0), "outage_s = 3.0 must be above 0 and below outage_every_s = 3.0"),
        ((0.0, 3.0), "outage_s = 0.0 must be above 0"),
        ((-1.0, 3.0), "outage_s = -1.0 is outside 0 to 1e[+]09"),
        ((0.5, math.inf), "outage_every_s = inf is outside 0 to 1e[+]09"),
        ((0.0, 0.0, [(1.0, 0.0)]), "0.0 s at 1.0 s: each must be longer than 0"),
        ((0.0, 0.0, [(-1.0, 1.0)]), "begin at 0 or later"),
        ((0.0, 0.0, [(math.nan, 1.0)]), "begin at 0 or later"),
        ((0.0, 0.0, [(1e300, 1.0)]), "both at most 1e[+]09 s"),
        ((0.0, 0.0, [(1.0, 1e300)]), "both at most 1e[+]09 s"),
    ],
)
def test_an_impossible_outage_is_refused(arguments: tuple, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Outages(*arguments)
