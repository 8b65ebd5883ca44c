"""Adaptive jitter buffer: laws on any network, scenarios, and the vector of SPEC.md 15.7."""

from itertools import pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.line import jitter_buffer
from cogrip.protocol.line.delays import HELD_MS, expected_frames, one_way
from cogrip.protocol.line.jitter_buffer import HYSTERESIS, REPEAT, SKIP, AdaptiveJitterBuffer, make_jitter_buffer
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.link_profile import LinkProfile
from cogrip.protocol.rates import Rates
from cogrip.protocol.settings import Playout, resolve, seat_settings
from cogrip.protocol.settings_table import SettingsError
from cogrip.sim.session.link import HOLD_MS

from tests.protocol.spec_page import rows, section
from tests.protocol.test_line import FRAME_S, CheckedLine, Conditions, drive, networks, noise

HZ = 128


class Scene:
    """A line whose datagrams have given delays."""

    def __init__(self, redundancy: int = 8, hz: int = HZ) -> None:
        self.sender, self.receiver = LineSender(1, redundancy), LineReceiver(1, "auto", 1.0 / hz)
        self.hz = hz
        self.flight: list[tuple[float, int]] = []
        self.contents: list[object] = []
        self.offsets: list[int] = []  # pop less the frame played, at every pop
        self.take = 0

    def run(self, seconds: float, delay_s: object, clock: float = 1.0) -> None:
        """Run the line. delay_s: of each datagram, None where it is lost. clock: the sender's period over the receiver's."""
        assert callable(delay_s)
        for _ in range(round(seconds * self.hz)):
            now_s = self.take / self.hz + 1e-9
            while len(self.contents) * clock / self.hz <= now_s:
                sent_s = len(self.contents) * clock / self.hz
                self.sender.push((0.1,))
                late_s = delay_s(sent_s)
                if late_s is not None:
                    self.flight.append((sent_s + late_s, len(self.contents)))
                self.contents.append(self.sender.contents())
            for arrival in sorted(one for one in self.flight if one[0] <= now_s):
                self.flight.remove(arrival)
                assert self.receiver.receive(*self.contents[arrival[1]])  # type: ignore[misc]
            self.receiver.pop()
            if self.receiver.acknowledged:
                self.offsets.append(self.take + 1 - self.receiver.acknowledged)
            self.take += 1

    @property
    def late(self) -> int:
        return self.receiver.count().late

    def depth(self, seconds: float) -> float:
        """Return the mean offset of the last seconds."""
        last = self.offsets[-round(seconds * self.hz) :]
        return sum(last) / len(last)


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
    real = checked.receiver.pop

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

    checked.receiver.pop = pop  # type: ignore[method-assign]
    drive(checked, conditions, noise(1, seed), frames=400, seed=seed)
    assert played == sorted(set(played))
    assert (account.least_frames <= account.depth_frames <= account.most_frames) or not played
    assert moves == account.repeated + account.skipped


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.integers(-40, 40), st.booleans(), st.booleans()), max_size=300))
def test_whatever_arrives_moves_are_single_and_skips_apart(arrivals: list[tuple[int, bool, bool]]) -> None:
    playout = AdaptiveJitterBuffer(1.0 / HZ)
    playout.begin(3)
    skips = []
    for take, (lead, here, fresh) in enumerate(arrivals):
        if fresh:
            playout.arrived(lead)
        move = playout.decide(lead, here, fresh)
        assert move in (jitter_buffer.PLAY, REPEAT, SKIP)
        assert not (here and move == REPEAT), "what is there is played or passed over, it does not wait"
        assert not (not here and move == SKIP and lead <= 0), "there is nothing to play instead"
        if move == SKIP:
            skips.append(take)
    assert all(later - one >= jitter_buffer.SPACING for one, later in pairwise(skips))
    assert playout.depths()[2] <= jitter_buffer.DEEPEST + 40


def test_the_page_s_vector() -> None:
    sender, receiver = LineSender(1, 2), LineReceiver(1, "auto", FRAME_S)
    contents = []
    take = 0
    for pops, brings, plays, moves in rows(section("15.7"), "pops"):
        first, last = (int(number) for number in pops.split(" to "))
        assert first == take
        for take in range(first, last + 1):
            sender.push((1.0,))
            contents.append(sender.contents())
            if brings != "-":
                assert receiver.receive(*contents[take - int(brings)])
            receiver.pop()
            played = receiver.acknowledged - 1 if receiver.acknowledged and not receiver.gap else None
            assert played == (None if plays == "-" else take - int(plays)), take
        account = receiver.playout_account()
        assert [account.repeated, account.skipped] == [int(number) for number in moves.split()]
        take = last + 1
    assert take == 1601


@pytest.mark.parametrize("hz", [32, 128, 512])
@pytest.mark.parametrize("delay_s", [0.0, 0.0201, 0.28])
def test_a_constant_link_loses_nothing_and_is_held_by_no_frame_more(hz: int, delay_s: float) -> None:
    scene = Scene(hz=hz)
    scene.run(4.0, lambda _: delay_s)
    account = scene.receiver.playout_account()
    assert (account.most_frames, account.repeated, account.skipped) == (0, 0, 0)
    assert scene.late == scene.receiver.lost == 0
    assert set(scene.offsets) == {one_way(1e3 * delay_s, 0, Rates(hz, hz)).frames}


def test_a_longer_path_is_followed_within_a_fifth_of_a_second() -> None:
    scene = Scene()
    scene.run(10.0, lambda _: 0.020)
    scene.run(0.2, lambda _: 0.050)
    assert scene.offsets[-1] == 7
    assert scene.late <= 16  # 8 pops to be sure, and as many as the path has become longer, 4
    lost = scene.late
    scene.run(5.0, lambda _: 0.050)
    assert (scene.late, scene.depth(5.0)) == (lost, 7.0)


def test_a_sender_that_has_fallen_far_behind_is_waited_for() -> None:
    """The sender is behind by more frames than a receiver remembers."""
    scene = Scene()
    scene.run(1.0, lambda _: 0.020)
    scene.run(12.0, lambda _: None)
    for number in range(129, 4000):
        first = number - 7
        scene.receiver.receive(first, (0.1,) * 8, (0.1 * first,), (0.01 * first,))
        scene.receiver.pop()
        if number > 129 and not scene.receiver.gap:
            break
    account = scene.receiver.playout_account()
    assert not scene.receiver.gap
    assert account.repeated > 1024
    assert 0.0 <= account.depth_frames <= account.most_frames <= jitter_buffer.DEEPEST + 1
    assert number < 129 + 2.1 * 12 * HZ


def test_a_shorter_path_is_followed_within_six_seconds_and_one_frame_at_a_time() -> None:
    scene = Scene()
    random = Random(1)
    scene.run(20.0, lambda _: 0.050 + gamma(random, 0.004))
    before, skipped = scene.depth(5.0), scene.receiver.playout_account().skipped
    scene.run(6.0, lambda _: 0.020 + gamma(random, 0.004))
    assert 3 <= before - scene.offsets[-1] <= 4  # 30 ms are 3.84 frames
    assert scene.receiver.playout_account().skipped - skipped == before - scene.offsets[-1]


def test_a_path_longer_than_the_weight_of_everything_lost_is_followed_too() -> None:
    scene = Scene()
    scene.run(5.0, lambda _: 0.020)
    scene.run(3.0, lambda _: 0.020 + 1.5 * jitter_buffer.WEIGHT_S)
    assert scene.depth(0.5) == one_way(20.0 + 1.5e3 * jitter_buffer.WEIGHT_S, 0, Rates(HZ, HZ)).frames


@pytest.mark.parametrize("ppm", [100, -100])
def test_a_drifting_clock_is_followed(ppm: int) -> None:
    """Ten times as much as crystals drift: 7.7 frames in 60 s."""
    scene = Scene()
    scene.run(60.0, lambda _: 0.0201, clock=1.0 + 10e-6 * ppm)
    drift = 60.0 * HZ * 10e-6 * ppm
    account = scene.receiver.playout_account()
    assert account.repeated - account.skipped == pytest.approx(drift, abs=1.5)
    assert scene.late <= 10 * abs(drift)
    assert account.most_frames <= 1


def test_outages_are_lost_and_leave_the_depth_alone() -> None:
    scene = Scene()
    random = Random(1)
    scene.run(30.0, lambda sent_s: None if sent_s % 3.0 > 2.5 else 0.030 + gamma(random, 0.004))
    account = scene.receiver.playout_account()
    assert account.most_frames <= 2
    assert scene.receiver.lost > 400
    assert account.repeated + account.skipped <= 2


def test_a_stall_that_is_let_go_all_at_once_leaves_the_depth_alone() -> None:
    scene = Scene()
    scene.run(30.0, lambda sent_s: 0.030 + max(0.0, 0.3 - sent_s % 3.0) if sent_s > 1.0 else 0.030)
    assert scene.receiver.playout_account().most_frames == 0


def test_the_depth_follows_the_jitter_up_and_down() -> None:
    scene = Scene()
    random = Random(1)
    scene.run(15.0, lambda _: 0.03 + gamma(random, 0.020))
    rough = scene.depth(5.0)
    scene.run(15.0, lambda _: 0.03 + gamma(random, 0.002))
    calm = scene.depth(5.0)
    scene.run(15.0, lambda _: 0.03 + gamma(random, 0.020))
    assert rough >= calm + 3.0
    assert scene.depth(5.0) >= calm + 2.0


@pytest.mark.parametrize(("better", "skips"), [(HYSTERESIS - 0.1, False), (HYSTERESIS + 0.1, True)])
def test_a_shallower_depth_must_be_better_by_the_hysteresis(better: float, skips: bool) -> None:
    """J(1) - J(0) = 1 - W / (N - 1) where one frame in N is late by one."""
    every = 1 + round(jitter_buffer.weight_frames(1.0 / HZ) / (1.0 - better))
    playout = AdaptiveJitterBuffer(1.0 / HZ)
    playout.begin(0)
    playout.arrived(-1)
    assert playout.decide(-1, False, True) == REPEAT
    for take in range(1, 20 * every):
        playout.arrived(0 if take % every == 0 else 1)  # x = 1, else x = 0
        if playout.decide(1, True, True) == SKIP:
            break
    assert playout.skipped == skips


def test_frames_are_a_number_or_auto() -> None:
    assert isinstance(make_jitter_buffer(0, FRAME_S), jitter_buffer.FixedJitterBuffer)
    assert isinstance(make_jitter_buffer("auto", FRAME_S), AdaptiveJitterBuffer)
    assert jitter_buffer.cost(2, 1.0, 3.0, 64.0) == 2 + 64.0 / 3.0
    assert jitter_buffer.cost(2, 1.0, 0.0, 64.0) == float("inf")
    assert HELD_MS == HOLD_MS


@pytest.mark.parametrize(
    ("frames", "allowed"),
    [
        (-1, "expects a whole number of at least 0"),
        (257, "expects a whole number of at most 256"),
        ("fast", 'expects a whole number from 0 to 256 or "auto"'),
        (1.5, 'expects a whole number from 0 to 256 or "auto"'),
        (True, 'expects a whole number from 0 to 256 or "auto"'),
    ],
)
def test_frames_that_cannot_be_set_are_told_what_can(frames: object, allowed: str) -> None:
    with pytest.raises(SettingsError) as error:
        resolve({"playout": {"frames": frames}})
    assert str(error.value) == f"playout.frames: {allowed}; got {frames!r}"


def test_what_is_set_is_what_is_expected() -> None:
    rates = Rates(1024, 128)
    assert expected_frames(Playout(frames=7), LinkProfile(jitter_ms=50.0, loss=0.3), rates) == 7
    assert expected_frames(Playout(frames="auto"), LinkProfile(delay_ms=33.0), rates) == 0
    assert expected_frames(Playout(frames="auto"), LinkProfile(loss=0.5), rates) > 0
    assert expected_frames(Playout(frames="auto"), LinkProfile(reorder=0.2), rates) > 0
    without_repetition = Playout(frames="auto", redundancy=1)
    assert expected_frames(without_repetition, LinkProfile(loss=0.5), rates) == 0


def test_compensation_counts_the_frames_that_auto_will_hold() -> None:
    table = {
        "coupling": {"compensate": True, "impedance_nspm": 40.0},
        "link": {"delay_ms": 10.0, "jitter_ms": 6.0},
        "users": [{"name": "anna"}],
    }
    link = LinkProfile(delay_ms=10.0, jitter_ms=6.0)
    held = expected_frames(Playout(frames="auto"), link, Rates(1024, 128))
    assert held >= 1
    auto, fixed, none = (
        seat_settings(resolve(table, {"playout.frames": frames}), 0).rendered_npm for frames in ("auto", held, 0)
    )
    assert auto == fixed > none
