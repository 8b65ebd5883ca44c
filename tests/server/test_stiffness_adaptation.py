"""Stiffness adaptation to the measured delay, without making energy."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.protocol.laws.felt_stiffness import MOST_GAIN
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import ServerCore
from cogrip.server.schemes import make_world
from cogrip.server.seats.stiffness_adaptation import FOLLOW_S, REPORT_EVERY_S, REPORTS, StiffnessAdapter
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.grip_step import MOST_SAVED_J
from cogrip.server.worlds.push import PushWorld

from tests.server.object_worlds import FOLLOWING, drawn_seats, stored_j

FRAME_MS = 7.8125


def seat(**coupling: object) -> SeatSettings:
    table = {"coupling": {"impedance_nspm": 50.0, "compensate": True, **coupling}, "link": {"delay_ms": 2 * FRAME_MS}}
    return seat_settings(resolve(table), 0)


class Followed:
    """A follower, and the loops that it hears of."""

    def __init__(self, **coupling: object) -> None:
        self.seat = seat(**coupling)
        self.loops = LoopMeter(128)
        self.adapter = StiffnessAdapter(self.seat, self.loops)
        self.aims = [self.seat.rendered_npm]

    def hear(self, loop: int, frames: int) -> None:
        for _ in range(frames):
            self.loops.add(loop)
            aim = self.adapter.update()
            self.aims.append(self.aims[-1] if aim is None else aim)


@pytest.fixture
def followed() -> Followed:
    return Followed()


def test_what_the_settings_say_stands_while_the_median_of_the_delay_is_as_they_say(followed: Followed) -> None:
    random = np.random.default_rng(1)
    for _ in range(2000):
        followed.hear(int(random.choice([4, 5, 5, 5, 6])), 1)
    assert set(followed.aims) == {followed.seat.rendered_npm}
    assert followed.seat.rendered_npm == pytest.approx(1000.0 / (1.0 - 5 * FRAME_MS * 1e-3 / 100.0 * 1000.0))


@pytest.mark.parametrize("loop", [1, 3, 9])
def test_another_delay_is_followed_slowly_both_ways_and_to_the_end(followed: Followed, loop: int) -> None:
    followed.hear(5, 200)
    followed.hear(loop, 64)
    assert len(set(followed.aims)) == 1, "half a second of another delay is not the median of a second"
    followed.hear(loop, 800)
    goal = 1000.0 / (1.0 - loop * FRAME_MS * 1e-3 / 100.0 * 1000.0)  # 1/K' = 1/K - C_line
    assert followed.aims[-1] == pytest.approx(goal, rel=1e-12)
    rates = np.abs(np.diff(np.log(followed.aims))) / (FRAME_MS * 1e-3)
    assert rates.max() <= 1.0 / FOLLOW_S
    assert np.all(np.diff(followed.aims) >= 0) if loop > 5 else np.all(np.diff(followed.aims) <= 0)
    assert followed.adapter.reported == ""


def test_what_is_out_of_reach_is_said_once_with_what_would_do_and_as_much_as_can_be_is_rendered(
    followed: Followed,
) -> None:
    followed.hear(5, 200)
    followed.hear(13, 2000)  # C_line = 101.6 ms / 100: softer than 1000 N/m
    assert followed.aims[-1] == 1000.0 * MOST_GAIN
    assert not followed.adapter.reached
    words = followed.adapter.reported
    assert "1000 N/m is out of reach by the delay now measured (94 ms both ways together)" in words
    assert "984.6 N/m" in words
    assert "coupling.impedance_nspm above 50.78 would do" in words
    enough, little = (seat(impedance_nspm=b).line_compliance(13) for b in (50.79, 50.77))
    assert enough < 1e-3 < little
    followed.adapter.reported = ""
    followed.hear(13, 1000)
    assert followed.adapter.reported == ""
    felt_npm = 1.0 / (1.0 / 1e5 + 1.0 / 984.615)  # 975: as stiff as the line but for 1 %
    assert followed.seat.predicted_stiffness(13) == pytest.approx(felt_npm, rel=1e-4)
    followed.hear(5, 2000)
    assert "1000 N/m is within reach again" in followed.adapter.reported
    assert followed.aims[-1] == pytest.approx(followed.seat.rendered_npm)


def swing(followed: Followed, seconds: int) -> list[tuple[int, str]]:
    """Loops within reach and out of it, as fast as the median of a second lets them; frame and text of each word."""
    heard = []
    for frame in range(128 * seconds):
        followed.hear(13 if frame // 128 % 2 else 5, 1)
        if followed.adapter.reported:
            heard.append((frame, followed.adapter.reported))
            followed.adapter.reported = ""
    return heard


def test_a_loop_that_swings_for_ever_says_a_word_a_minute_and_counts_the_others(followed: Followed) -> None:
    followed.hear(5, 200)
    heard = swing(followed, 600)
    at_once = [frame for frame, _ in heard if frame < 8 * 128]
    assert len(at_once) == REPORTS
    assert REPORTS < len(heard) <= REPORTS + 600 // REPORT_EVERY_S
    for number, (_, words) in enumerate(heard):  # each says something else than the one before
        assert ("out of reach" in words) == (number % 2 == 0)
    changes = 600 - 1  # one in each second but the first
    assert followed.adapter.withheld >= changes - REPORTS - 600 // REPORT_EVERY_S
    assert followed.adapter.withheld <= changes - REPORTS


@pytest.mark.parametrize("loop", [5, 13])
def test_what_holds_in_the_end_is_said_in_the_end(followed: Followed, loop: int) -> None:
    followed.hear(5, 200)
    heard = swing(followed, 9)
    assert len(heard) == REPORTS
    followed.hear(loop, 3 * REPORT_EVERY_S * 128)
    reached = loop == 5
    assert followed.adapter.reached is reached
    assert followed.adapter.reported == "" if reached else "out of reach" in followed.adapter.reported
    assert "within reach again" in heard[-1][1]


def test_what_was_not_said_is_counted_by_name() -> None:
    core = ServerCore(
        [resolve({"coupling": {"impedance_nspm": 50.0, "compensate": True}})], "1", AdmissionServices(lambda: 1)
    )
    [room] = core.rooms
    followed = Followed()
    room.seats[0].adapter = followed.adapter
    followed.hear(5, 200)
    told = 0
    for second in range(40):
        followed.hear(13 if second % 2 else 5, 128)
        core.tick(room, second)
        told += sum(event.event == "stiffness" for event in core.events)
        core.events.clear()
    assert told == REPORTS
    assert core.dropped == {"stiffness word": 39 - REPORTS}


@given(st.lists(st.tuples(st.integers(1, 4096), st.integers(1, 400)), max_size=12))
def test_whatever_loop_a_peer_makes_one_believe_the_aim_is_bounded_and_slow(said: list[tuple[int, int]]) -> None:
    followed = Followed()
    for loop, frames in said:
        followed.hear(loop, frames)
    aims = np.array(followed.aims)
    assert np.all((aims >= 1000.0) & (aims <= 1000.0 * MOST_GAIN))
    assert np.all(np.abs(np.diff(np.log(aims))) <= FRAME_MS * 1e-3 / FOLLOW_S + 1e-12)


@pytest.mark.parametrize(
    "other",
    [{"compensate": False}, {"kind": "coupling"}, {"kind": "tdpa"}, {"server_step": "paper", "decimator": "lowpass"}],
)
def test_no_other_seat_follows_and_only_passive_worlds_change_a_spring(other: dict[str, object]) -> None:
    assert not seat(**other).adapts_stiffness
    world = make_world([seat(**other)])
    assert world.can_adapt_stiffness == ("compensate" in other)
    if not world.can_adapt_stiffness:
        with pytest.raises(NotImplementedError, match=type(world).__name__):
            world.set_target_stiffness(0, 500.0)


# Energy ----------------------------------------------------------------------------------------------------------------


def people(kind: str, random: np.random.Generator, count: int = 1, axes: int = 1) -> list[SeatSettings]:
    """Return seats that follow, at a world of KINDS."""
    return drawn_seats(random, count, axes, kind, **FOLLOWING)


KINDS = {"cube": GripWorld, "faces": PushWorld, "wall": PushWorld}


@settings(max_examples=40)
@given(st.sampled_from(sorted(KINDS)), st.integers(1, 4), st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_no_sequence_of_aims_makes_energy(kind: str, count: int, axes: int, seed: int) -> None:
    """All that came in through the lines is at least what is stored now, at every step, whatever is aimed at in between."""
    random = np.random.default_rng(seed)
    seats = people(kind, random, count, axes)
    world = KINDS[kind](seats)
    for user in range(count):
        world.join(user, np.zeros(axes))
    scale, base = 0.0, seats[0].rendered_npm
    wave = np.zeros((count, axes))
    for step in range(300):
        if step % 3 == 0:
            for user in range(count):
                world.set_target_stiffness(user, base * 10.0 ** random.uniform(-2.0, 2.0))
        if step % 20 == 0:
            wave = random.uniform(-2.0, 2.0, (count, axes))
        if step == 200:
            world.leave(0)
            wave[0] = 0.0
        if step == 220:
            world.join(0, np.zeros(axes))
        world.step(wave)
        scale = max(scale, float(np.abs(world.port_work).sum()), stored_j(world))
        assert stored_j(world) <= float(world.port_work.sum()) + 1e-9 * (1.0 + scale)
    ledger = world._paid_j if isinstance(world, GripWorld) else world._ledger
    assert max(ledger) <= MOST_SAVED_J
    assert min(ledger) >= -1e-12 * (1.0 + scale)


@pytest.mark.sample(1)
@pytest.mark.parametrize("kind", ["cube", "wall"])
def test_energy_is_made_where_the_ledger_is_not_asked(kind: str) -> None:
    """That the law above can fail: the same sequence with a ledger that is always full."""
    worst = 0.0
    for seed in range(6):
        random = np.random.default_rng(seed)
        world = KINDS[kind](people(kind, random))
        world.join(0, np.zeros(1))
        for step in range(400):
            if isinstance(world, GripWorld):
                world._paid_j = [1e6]
            else:
                world._ledger[0] = 1e6
            if step % 20 == 0:
                world.set_target_stiffness(0, world.target_stiffness[0, 0] * (100.0 if step % 40 else 0.01))
            world.step(np.array([[1.0 if step % 40 < 20 else -0.2]]))
            worst = max(worst, stored_j(world) - float(world.port_work.sum()))
    assert worst > 1e-3


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_nothing_stretched_costs_nothing_and_what_is_lowered_can_be_raised_again(kind: str) -> None:
    random = np.random.default_rng(5)
    [one] = people(kind, random)
    K = one.rendered_npm
    world = KINDS[kind]([one])
    world.join(0, np.zeros(1))
    for _ in range(60):
        world.step(np.zeros((1, 1)))
    assert world.accounts.stiffness(0) == K
    world.set_target_stiffness(0, 2.0 * K)
    for _ in range(60):
        world.step(np.zeros((1, 1)))
    assert world.accounts.stiffness(0) == 2.0 * K
    for step in range(200):  # pressed in, and held
        world.step(np.array([[0.5 if step < 40 else 0.0]]))
        if step == 60:
            world.set_target_stiffness(0, K)
        if step == 61:
            assert world.accounts.stiffness(0) == K
            world.set_target_stiffness(0, 1.5 * K)
    assert world.accounts.stiffness(0) == 1.5 * K
