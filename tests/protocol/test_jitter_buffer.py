"""Adaptive jitter buffer: laws on any network, scenarios, and the vector of SPEC.md 15.7."""

from itertools import pairwise
from math import ceil
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.line import jitter_buffer
from cogrip.protocol.line.jitter_buffer import AdaptiveJitterBuffer
from cogrip.protocol.line.receiver import LATE, MOST_UNHEARD, LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.delays import HELD_MS, line_delay
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.sections import Playout
from cogrip.sim.link import HOLD_MS

from tests.extent import long
from tests.protocol.spec_page import rows, section
from tests.protocol.test_line import FRAME_S, CheckedLine, Conditions, drive, networks, noise

HZ = 128
M = 8  # ticks in a frame


class Scene:
    """A client's line whose datagrams have given delays."""

    def __init__(self, redundancy: int = 8, hz: int = HZ, late: float = LATE) -> None:
        self.sender = LineSender(1, redundancy)
        self.receiver = LineReceiver(1, "auto", 1.0 / hz, late=late, ticks=M)
        self.hz = hz
        self.flight: list[tuple[float, int]] = []
        self.contents: list[object] = []
        self.offsets: list[int] = []  # ticks from a frame's making to its playing, at every pop that plays one
        self.tick = self.border = 0

    def run(self, seconds: float, delay_s: object, clock: float = 1.0) -> None:
        """Run the line. delay_s: of each datagram, None where it is lost. clock: the sender's period over the receiver's."""
        assert callable(delay_s)
        for _ in range(round(seconds * self.hz) * M):
            now_s = self.tick / self.hz / M + 1e-9
            while len(self.contents) * clock / self.hz <= now_s:
                sent_s = len(self.contents) * clock / self.hz
                self.sender.push((0.1,))
                late_s = delay_s(sent_s)
                if late_s is not None:
                    self.flight.append((sent_s + late_s, len(self.contents)))
                self.contents.append(self.sender.contents())
            for arrival in sorted(one for one in self.flight if one[0] <= now_s):
                self.flight.remove(arrival)
                assert self.receiver.receive(*self.contents[arrival[1]], early=self.border - self.tick)  # type: ignore[misc]
            if self.tick >= self.border:
                self.receiver.pop()
                self.border = self.tick + self.receiver.hold
                if self.receiver.played:
                    self.offsets.append(self.tick - (self.receiver.acknowledged - 1) * M)
            self.tick += 1

    @property
    def late(self) -> int:
        return self.receiver.count().late

    def depth(self, seconds: float) -> float:
        """Return the mean offset of the last seconds [ticks]."""
        last = self.offsets[-round(seconds * self.hz) :]
        return sum(last) / len(last)


def ticks(seconds: float, hz: int = HZ) -> int:
    return ceil(seconds * hz * M - 1e-6)


def gamma(random: Random, mean_s: float) -> float:
    return random.gammavariate(2.0, 0.5 * mean_s)


@settings(max_examples=60, deadline=None)
@given(networks, st.integers(0, 2**32))
def test_depth_changes_one_frame_at_a_time_and_nothing_is_played_twice(conditions: Conditions, seed: int) -> None:
    checked = CheckedLine(delay="auto", redundancy=4)  # type: ignore[arg-type]
    cursors: list[int] = []
    played: list[int] = []
    account = checked.receiver.playout_account()
    moves = 0
    real = checked.pop

    def pop(frames: int = 1) -> tuple[float, ...]:
        nonlocal account, moves
        before = checked.receiver.acknowledged
        wave = real(frames)
        after, now = checked.receiver.acknowledged, checked.receiver.playout_account()
        moved = now.repeated - account.repeated, now.skipped - account.skipped
        assert moved in ((0, 0), (1, 0), (0, 1))
        if cursors and before:
            assert after - before == frames - moved[0] + moved[1]
        if after and not checked.receiver.gap:
            played.append(after)
        cursors.append(after)
        account, moves = now, moves + sum(moved)
        return wave

    checked.pop = pop  # type: ignore[method-assign]
    drive(checked, conditions, noise(1, seed), frames=400, seed=seed)
    assert played == sorted(set(played))
    assert (account.least_frames <= account.depth_frames <= account.most_frames) or not played
    assert moves == account.repeated + account.skipped


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.tuples(st.integers(-40, 40), st.booleans(), st.integers(0, M - 1), st.integers(-9, 9)), max_size=300),
    st.sampled_from((1, M)),
)
def test_whatever_arrives_moves_are_bounded_and_skips_apart(
    arrivals: list[tuple[int, bool, int, int]], quantum: int
) -> None:
    buffer = AdaptiveJitterBuffer(LATE, 1.0 / HZ, M, quantum)
    buffer.begin(3)
    skips = []
    for border, (lead, here, early, phase) in enumerate(arrivals):
        buffer.arrived(lead, early, phase)
        move = buffer.decide(lead, here, True)
        assert -M <= move <= M
        assert move % quantum == 0
        assert not (here and move > 0), "what is there is played or cut short, it does not wait"
        assert not (not here and move < 0 and lead <= 0), "there is nothing to play instead"
        if move < 0:
            skips.append(border)
    assert all(later - one >= jitter_buffer.SPACING for one, later in pairwise(skips))
    assert buffer.depths()[2] <= jitter_buffer.DEEPEST + 40


@given(st.lists(st.integers(-200, 200), min_size=1, max_size=1500), st.sampled_from((0.0, 0.01, 0.1)))
def test_what_is_spare_leaves_the_late_rate(xs: list[int], late: float) -> None:
    """Shift all by what is spare: of the last WINDOW no more than `late` are late, and one tick more would be too many.

    Or one tick more would make one late of the newest, which alone count where they are all earlier.
    """
    buffer = AdaptiveJitterBuffer(late, 1.0 / HZ, M, M)
    for x in xs:
        buffer.arrived(0, -x)
    window = xs[-jitter_buffer.WINDOW :]
    spare = buffer.spare()
    quiet = xs[-(len(xs) - 1) % jitter_buffer.HALF_QUIET - 1 - jitter_buffer.HALF_QUIET :]
    if all(x + spare < 0 for x in quiet):
        raise AssertionError("a tick more would make nothing late")
    if sum(x + spare > 0 for x in window) > late * len(window):
        assert max(x + spare for x in quiet) == 0
    else:
        assert sum(x + spare + 1 > 0 for x in window) > late * len(window) or max(x + spare for x in quiet) == 0


def test_a_shift_of_the_sender_is_known_at_once() -> None:
    """Lateness counts from the sender's phase, so old entries stay good: 5 ticks are spare; after a shift by 3, 2 are."""
    buffer = AdaptiveJitterBuffer(LATE, 1.0 / HZ, M, M)
    for _ in range(300):
        buffer.arrived(0, 5, 0)
    assert buffer.spare() == 5
    buffer.arrived(0, 2, 3)
    assert buffer.spare() == 2


def test_the_page_s_vector() -> None:
    sender, receiver = LineSender(1, 2), LineReceiver(1, "auto", FRAME_S, ticks=M)
    contents: list[tuple[object, ...]] = []
    flight: dict[int, list[int]] = {}
    tick = border = 0
    for frames, delay, offset, moves in rows(section("15.7"), "frames"):
        first, last = (int(number) for number in frames.split(" to "))
        assert first == len(contents)
        while len(contents) <= last or tick % M:
            if tick % M == 0:
                sender.push((1.0,))
                contents.append(sender.contents())
                if delay != "-":
                    flight.setdefault(tick + int(delay), []).append(len(contents) - 1)
            for number in flight.pop(tick, []):
                assert receiver.receive(*contents[number], early=border - tick)  # type: ignore[arg-type]
            if tick >= border:
                receiver.pop()
                border = tick + receiver.hold
                if receiver.played:
                    played = tick - (receiver.acknowledged - 1) * M
            tick += 1
        account = receiver.playout_account()
        assert (played, account.repeated, account.skipped) == (int(offset), *map(int, moves.split())), frames
    assert tick == 4096 * M


@pytest.mark.parametrize("hz", [32, 128, 512])
@pytest.mark.parametrize("delay_s", [0.0, 0.0201, 0.28])
def test_a_constant_link_loses_nothing_and_is_held_by_no_tick_more(hz: int, delay_s: float) -> None:
    scene = Scene(hz=hz)
    scene.run(4.0, lambda _: delay_s)
    account = scene.receiver.playout_account()
    assert (account.most_frames, account.repeated, account.skipped) == (0, 0, 0)
    assert scene.late == scene.receiver.lost == 0
    assert set(scene.offsets) == {ticks(delay_s, hz)}


def test_a_longer_path_is_followed_within_a_fifth_of_a_second() -> None:
    scene = Scene()
    scene.run(10.0, lambda _: 0.020)
    scene.run(0.2, lambda _: 0.050)
    assert scene.offsets[-1] == ticks(0.050)
    assert scene.late <= 16  # more than 1 % of WINDOW, and as many as the path has become longer, 4
    lost = scene.late
    scene.run(5.0, lambda _: 0.050)
    assert (scene.late, scene.depth(5.0)) == (lost, ticks(0.050))


def test_a_sender_that_has_fallen_far_behind_is_waited_for() -> None:
    """The sender is behind by more frames than a receiver remembers."""
    scene = Scene()
    scene.run(1.0, lambda _: 0.020)
    scene.run(12.0, lambda _: None)
    for number in range(129, 6000):
        first = number - 7
        scene.receiver.receive(first, (0.1,) * 8, (0.1 * first,), (0.01 * first,))
        scene.receiver.pop()
        if number > 129 and not scene.receiver.gap:
            break
    assert not scene.receiver.gap
    assert scene.receiver.playout_account().repeated > 1024
    assert number < 129 + 2.1 * 12 * HZ


def test_a_shorter_path_is_followed_once_nothing_has_needed_the_longer_one_for_a_while() -> None:
    scene = Scene()
    random = Random(1)
    scene.run(20.0, lambda _: 0.050 + gamma(random, 0.004))
    before = scene.depth(5.0)
    scene.run(1.9, lambda _: 0.020 + gamma(random, 0.004))
    assert scene.depth(0.1) > before - M, "some were late within HALF_QUIET"
    scene.run(8.0, lambda _: 0.020 + gamma(random, 0.004))
    assert before - scene.depth(0.1) == pytest.approx(ticks(0.030), abs=3.0)
    assert scene.receiver.lost == 0


@pytest.mark.sample(1)
@pytest.mark.parametrize("ppm", [100, -100])
def test_a_drifting_clock_is_followed(ppm: int) -> None:
    """Ten times as much as crystals drift: 61 ticks in 60 s."""
    scene = Scene()
    scene.run(60.0, lambda _: 0.0201, clock=1.0 + 10e-6 * ppm)
    drift = 60.0 * HZ * M * 10e-6 * ppm
    assert scene.offsets[-1] - scene.offsets[0] == pytest.approx(drift, abs=12.0)  # the window is 8 s long
    assert scene.late <= 12 * abs(drift)
    assert scene.receiver.playout_account().most_frames <= 2


@pytest.mark.long
def test_outages_are_lost_and_leave_the_depth_alone() -> None:
    scene = Scene()
    random = Random(1)
    scene.run(30.0, lambda sent_s: None if sent_s % 10.0 > 9.5 else 0.030 + gamma(random, 0.004))
    calm = Scene()
    random = Random(1)
    calm.run(30.0, lambda sent_s: 0.030 + gamma(random, 0.004))
    assert scene.receiver.lost > 100
    assert scene.depth(20.0) <= calm.depth(20.0) + M


def test_a_stall_that_is_let_go_all_at_once_leaves_the_depth_alone() -> None:
    """Ten frames of 1024 come late at most."""
    scene = Scene()
    scene.run(40.0, lambda sent_s: 0.030 + max(0.0, 0.07 - sent_s % 10.0) if sent_s > 1.0 else 0.030)
    assert scene.receiver.playout_account().most_frames == 0


@pytest.mark.sample(1)
@pytest.mark.parametrize("late", [0.0, long(0.01), 0.05])
def test_the_late_rate_is_the_one_that_is_set(late: float) -> None:
    scene = Scene(late=late)
    random = Random(1)
    scene.run(60.0, lambda _: 0.03 + gamma(random, 0.010))
    rate = scene.late / scene.receiver.count().sent
    assert late / 2 <= rate <= late + 0.004


@pytest.mark.parametrize("ticks_late", [1, 3, M - 1])
def test_a_frame_that_is_overdue_is_played_for_what_is_left_of_its_time(ticks_late: int) -> None:
    """Sums of waves and squares are those of the ticks: filling until then, the frame after."""
    receiver, sender = LineReceiver(1, "auto", FRAME_S, credit_j=1.0, ticks=M), LineSender(1, 1)
    waves, played, energy = [0.3, -0.2, 0.25, 0.1, 0.05], [], 0.0
    border, held = 0, 0.0
    for tick in range(len(waves) * M):
        number, step = divmod(tick, M)
        if step == (ticks_late if number == 2 else 0):
            for late in range(number + 1):
                sender = LineSender(1, 1)
                for wave in waves[: late + 1]:
                    sender.push((wave,))
            assert receiver.receive(*sender.contents(), early=border - tick)
            if receiver.overdue is not None:
                (held,) = receiver.play_overdue(border - tick)
        if tick >= border:
            (held,) = receiver.pop()
            border = tick + receiver.hold
        played.append(held)
        energy += 0.5 * FRAME_S / M * held * held
    assert played[2 * M + ticks_late : 3 * M] == [waves[2]] * (M - ticks_late)
    assert energy == pytest.approx(receiver.played_j, rel=1e-12)
    deficit = sum(waves) - sum(played) / M
    assert receiver.deficit[0] == pytest.approx(deficit, abs=1e-12)


@pytest.mark.parametrize(
    ("unheard", "plays"), [(1, True), (MOST_UNHEARD, True), (MOST_UNHEARD + 1, False), (75, False)]
)
def test_after_a_long_gap_an_overdue_frame_is_left_to_the_cross_fade(unheard: int, plays: bool) -> None:
    """The filling has faded by then: the line would jump to the wave, and with it the force of everybody who holds on."""
    receiver, sender = LineReceiver(1, 0, FRAME_S, credit_j=1.0, ticks=M), LineSender(1, 1)

    def come(early: int) -> None:
        sender.push((0.6,))
        receiver.receive(*sender.contents(), early=early)

    for _ in range(8):
        come(early=0)
        receiver.pop()
    for _ in range(unheard):
        filling = receiver.pop()
        sender.push((0.6,))
    receiver.receive(*sender.contents(), early=M - 1)  # the newest of them, a tick after its time
    assert (receiver.overdue is not None) is plays
    if plays:
        assert receiver.play_overdue(M - 1) == (0.6,)
    come(early=0)
    (next_wave,) = receiver.pop()
    if not plays:
        assert abs(next_wave - filling[0]) < 0.1
    for _ in range(2):  # a frame that came begins the count anew
        receiver.pop()
        sender.push((0.6,))
    receiver.receive(*sender.contents(), early=1)
    assert receiver.overdue == (0.6,)


def test_what_is_set_is_what_is_expected() -> None:
    assert HELD_MS == HOLD_MS
    rates, auto = Rates(1024, 128), Playout(frames="auto")
    assert line_delay(Playout(frames=7), LinkProfile(jitter_ms=50.0, loss=0.3), rates).frames == 7
    assert line_delay(auto, LinkProfile(delay_ms=33.0), rates).ticks == 34
    assert line_delay(auto, LinkProfile(loss=0.5), rates).ticks > 0
    assert line_delay(auto, LinkProfile(reorder=0.2), rates).ticks > 0
    assert line_delay(Playout(frames="auto", redundancy=1), LinkProfile(loss=0.5), rates).ticks == 0
    strict, loose = (Playout(frames="auto", late=late) for late in (0.001, 0.1))
    jitter = LinkProfile(jitter_ms=8.0)
    assert (
        line_delay(strict, jitter, rates).ticks
        > line_delay(auto, jitter, rates).ticks
        > line_delay(loose, jitter, rates).ticks
    )
