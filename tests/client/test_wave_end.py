"""The client's end of a line, while it yields in a gap, and while impedance and filter change: no work is lost."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import sqrt
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.client.coupling.line_tuner import GENTLE, RATE, LineTuner
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.protocol.line.concealment import YIELDING_GAIN
from cogrip.protocol.line.line_in_use import FOLLOW_S
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.line_tuning import Tuning
from cogrip.protocol.wire.clock import Clock
from cogrip.protocol.wire.messages import Waves, decode

from tests.client.seated_client import ROOT, T_C, T_N, M, next_waves, seat
from tests.interpreted import needs_interpreted

B = 20.0
AUTO = {"impedance_nspm": "auto", "wave_filter_hz": "auto"}


class End:
    """A coupling, and a server that answers with whatever wave it is told, made with whatever impedance."""

    def __init__(self, latency: int = 0, axes: int = 1, playout: Mapping[str, Any] = {"frames": 0}, **coupling: object):
        self.coupling = WaveCoupling(seat(object={"axes": axes}, coupling=coupling or AUTO, playout=playout))
        self.coupling.set_latency(latency)
        self.line, self.axes = LineSender(axes, 2), axes
        self.made_j, self.b, self.since = 0.0, 0.0, 0

    def answer(self, wave: float, b: float = 0.0, lost: bool = False) -> None:
        if b != self.b:
            self.b, self.since = b, self.line.next_number
        self.made_j += 0.5 * T_N * wave * wave
        sent = next_waves(self.line, *[wave] * self.axes)
        sent = replace(sent, made_j=self.made_j, impedance_nspm=self.b, since=self.since)
        assert lost or self.coupling.receive(sent)

    def frame(self, speed_mps: float) -> list[float]:
        """Run a frame at a speed. Returns the forces of the first axis."""
        forces, velocity = [], [speed_mps] * self.axes
        self.coupling.start_frame()
        for _ in range(M):
            force = self.coupling.force([0.0] * self.axes, velocity)
            before_j = self.coupling.port_j
            self.coupling.elapse(velocity, velocity)
            if not self.coupling.late.ticks:
                work_j = sum(force) * speed_mps * T_C
                assert self.coupling.port_j - before_j == pytest.approx(work_j, rel=1e-9, abs=1e-15)
            forces.append(force[0])
        self.coupling.end_frame()
        return forces

    def message(self) -> Waves:
        made = decode(self.coupling.message(7, Clock(), 1, (0.0,), (0.0,), (0.0,)))
        assert isinstance(made, Waves)
        return made


@given(st.integers(0, 2**32), st.sampled_from([0, 3]))
@settings(max_examples=60, deadline=None)
def test_the_line_gives_no_more_than_it_got_whatever_b_and_filter_do(seed: int, latency: int) -> None:
    """F y = (u^2 - v^2) / 2 tick by tick with the b of its own moment; the line down gives at most what was put in, and E0."""
    end, random = End(latency), Random(seed)
    for number in range(150):
        end.answer(random.uniform(-1.0, 1.0), random.choice([5.0, 10.0, 20.0, 40.0]) if number % 5 == 0 else end.b)
        end.frame(random.uniform(-0.2, 0.2))
        if random.random() < 0.3:
            end.coupling.tune(Tuning(random.uniform(1.0, 60.0), random.choice([0.0, 0.05, 0.4])))
        assert end.coupling.energy.used_j <= end.made_j + 1e-3 + 1e-12
    assert end.coupling.down_margin_j is not None
    assert end.coupling.down_margin_j >= -1e-3


@given(st.floats(1.001, 2.0), st.floats(0.1, 5.0), st.booleans())
def test_a_hand_at_rest_feels_at_most_half_the_change_of_b(factor: float, force_n: float, up: bool) -> None:
    """Upwards nothing: waves under way are made smaller. Downwards they cannot grow, so sqrt(b'/b) of the force is left."""
    end = End()
    for _ in range(8):
        end.answer(-force_n / sqrt(40.0), 20.0)
        before = end.frame(0.0)[-1]
    assert before == pytest.approx(force_n)
    end.coupling.tune(Tuning(20.0 * (factor if up else 1.0 / factor), 0.0))
    end.answer(-force_n / sqrt(40.0), 20.0)
    after = end.frame(0.0)
    assert after == pytest.approx([force_n * (1.0 if up else 1.0 / sqrt(factor))] * M)


@pytest.mark.parametrize("b", [10.0, 40.0])
def test_what_a_scaled_wave_lacks_of_its_displacement_is_owed(b: float) -> None:
    """A wave made with b' moves the port by v / sqrt(2b'); read with b it would have to be sqrt(b/b') v."""
    end, wave = End(), 0.5
    end.answer(wave, 20.0)
    end.frame(0.0)
    end.coupling.tune(Tuning(b, 0.0))
    end.answer(wave, 20.0)
    end.frame(0.0)
    kept = min(1.0, sqrt(20.0 / b))
    assert end.coupling.returning[0] == pytest.approx(kept * wave)
    assert end.coupling.deficit[0] == pytest.approx((sqrt(b / 20.0) - kept) * wave)


def test_answers_made_with_the_new_impedance_are_played_as_they_are() -> None:
    end = End()
    end.coupling.tune(Tuning(10.0, 0.0))
    for number in range(6):
        end.answer(0.5, 20.0 if number < 3 else 10.0)
        end.frame(0.0)
        assert (end.coupling._made_nspm == 10.0) == (number >= 3)
    assert end.coupling.returning == pytest.approx((0.5 + end.coupling.down.receiver._concealment.added[0],))


@pytest.mark.parametrize(("said", "read"), [(5e-324, 1.0), (1e4, 60.0)])
def test_what_a_server_says_is_bounded(said: float, read: float) -> None:
    end = End()
    for _ in range(30):
        end.answer(0.5, said)
        end.frame(0.0)
    assert end.coupling._made_nspm == read
    assert 0.0 < abs(end.coupling.returning[0]) < 1.0


def test_each_message_says_which_impedance_holds_and_since_when() -> None:
    end = End()
    for number in range(4):
        end.answer(0.1, 20.0)
        end.frame(0.1)
        message = end.message()
        assert (message.impedance_nspm, message.since) == ((20.0, 0) if number < 2 else (10.0, 2))
        if number == 1:
            end.coupling.tune(Tuning(10.0, 0.0))
    fixed = End(impedance_nspm=15.0, wave_filter_hz=0.0)
    fixed.frame(0.1)
    assert (fixed.message().impedance_nspm, fixed.message().since) == (0.0, 0)


# A tuner -------------------------------------------------------------------------------------------------------------


def metered(frames: int) -> LoopMeter:
    meter = LoopMeter(128)
    for _ in range(128):
        meter.add(frames)
    return meter


def tuner_of(delay_ms: float, carried_nspm: float = 30.0, **tables: Any) -> LineTuner:
    tuner = LineTuner(seat(**{"coupling": AUTO, "link": {"delay_ms": delay_ms}, **tables}))
    tuner.carried_nspm = carried_nspm
    return tuner


@pytest.mark.parametrize(("frames", "redundancy"), [(80, 8), (5, 8), (80, 20)])
def test_a_tuner_goes_in_small_steps(frames: int, redundancy: int) -> None:
    """b at most once in R frames, and as slowly as the loop is followed; S by GENTLE of S + T_n, and RATE of the time."""
    tuner, meter = tuner_of(150.0, playout={"redundancy": redundancy}), metered(frames)
    before, changed = tuner.begin(), -redundancy
    for number in range(4000):
        now = tuner.end_frame(meter)
        if now is None:
            continue
        if now.impedance_nspm != before.impedance_nspm:
            assert number - changed >= redundancy
            changed = number
            ratio = now.impedance_nspm / before.impedance_nspm
            assert abs(ratio - 1.0) <= 1.05 * redundancy * T_N / FOLLOW_S
        moved_s = abs(now.filter_lag_s - before.filter_lag_s)
        assert moved_s <= min(GENTLE * (before.filter_lag_s + T_N), RATE * T_N) * (1.0 + 1e-9)
        before = now
    assert before == tuner._goal


@pytest.mark.parametrize(("carried", "b"), [(30.0, 12.0), (7.0, 7.0), (0.2, 1.0)])
def test_no_more_is_asked_of_a_device_than_it_carries(carried: float, b: float) -> None:
    tuner = tuner_of(145.0, carried, coupling={"impedance_nspm": "auto"})
    assert tuner.begin().impedance_nspm == pytest.approx(b, rel=0.02)


@pytest.mark.parametrize(("automatic", "which"), [("impedance_nspm", 0), ("wave_filter_hz", 1)])
def test_a_number_stays_beside_what_is_automatic(automatic: str, which: int) -> None:
    tuner = tuner_of(300.0, coupling={"impedance_nspm": 20.0, automatic: "auto"})
    assert tuner.begin()[1 - which] == (0.0, 20.0)[which]
    for _ in range(2000):
        tuner.end_frame(metered(10))
    assert tuner.now[1 - which] == (0.0, 20.0)[which]
    assert tuner.now[which] == (20.0, 0.0)[which]


def test_a_new_line_of_the_seat_goes_on_with_the_loop_of_the_last() -> None:
    end, after = End(), End()
    end.coupling._tuner._follower.loop_s = 0.6  # type: ignore[union-attr]
    after.coupling.go_on_from(end.coupling)
    assert after.coupling._tuner.begin().impedance_nspm == pytest.approx(6.0)  # type: ignore[union-attr]


# A gap ---------------------------------------------------------------------------------------------------------------

FREE = sqrt(B / 2.0) * 0.1  # the wave of free motion at 0.1 m/s, v = sqrt(b/2) y: no force


def yielding(axes: int = 1, concealment: str = "elastic", encoder: str = "displacement") -> End:
    playout = {"frames": 2, "concealment": concealment}
    return End(axes=axes, playout=playout, impedance_nspm=B, encoder=encoder)


@pytest.mark.parametrize("axes", [1, 2, 3])
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), encoder=st.sampled_from(["displacement", "velocity"]))
def test_every_tick_gives_the_line_the_work_of_the_law(axes: int, seed: int, encoder: str) -> None:
    """F y = (u^2 - v^2) / 2, which `End.frame` asserts."""
    end, random = yielding(axes, encoder=encoder), Random(seed)
    for _ in range(120):
        end.answer(0.3, lost=random.random() >= 0.6)
        end.frame(random.uniform(-0.2, 0.2))
    assert end.coupling.count().applied > 0


def free_motion(concealment: str) -> list[float]:
    """Some trouble, then half a second of nothing. Returns the last force of each frame."""
    end, forces = yielding(concealment=concealment), []
    for number in range(200):
        end.answer(FREE, lost=40 <= number < 44 or 100 <= number < 164)
        forces.append(end.frame(0.1)[-1])
    return forces


def test_a_gap_feels_like_a_sixth_of_the_damping() -> None:
    """b y = 2 N with a matched termination; least_share^2 of it where the end yields. It comes slowly, and goes so too."""
    matched, soft = free_motion("zero"), free_motion("elastic")
    assert matched[160] == pytest.approx(B * 0.1)
    assert soft[160] == pytest.approx(YIELDING_GAIN**2 * B * 0.1, rel=0.05)
    assert max(abs(after - before) for before, after in pairwise(matched[90:])) > 1.9
    assert max(abs(after - before) for before, after in pairwise(soft[90:])) < 0.4


@needs_interpreted
def test_what_is_not_sent_in_a_gap_is_written_off_by_the_receiver() -> None:
    """sum u = sqrt(2b) x - sum v - sum e, and the receiver holds e: no displacement is forgotten."""
    end, written_off = yielding(), []
    for number in range(66):
        end.answer(FREE, lost=number in (20, 21) or number >= 60)
        end.frame(0.1)
    down = end.coupling.down
    receiver = down.receiver

    class Listening:
        """The receiver, and what is written off."""

        def __getattr__(self, name: str) -> object:
            return getattr(receiver, name)

        def __setattr__(self, name: str, value: object) -> None:
            setattr(receiver, name, value)

        def write_off(self, row: Sequence[float]) -> None:
            deficit = receiver.deficit[0]
            receiver.write_off(row)
            written_off.append(deficit - receiver.deficit[0])

    down.receiver = Listening()  # type: ignore[assignment]
    before, gone = sum(down.written_off) / M, 0.0
    for _ in range(30):
        end.answer(FREE, lost=True)
        end.frame(0.1)
        gone += end.coupling.sent[0] + end.coupling.returning[0]
    moved = 30 * ROOT * 0.1
    assert gone < 0.7 * moved
    rest = sum(written_off) - before + sum(down.written_off) / M
    assert gone + rest == pytest.approx(moved, rel=1e-9)


def test_a_clear_line_does_not_yield() -> None:
    end = yielding(axes=2)
    for _ in range(50):
        end.answer(0.2)
        force = end.frame(0.05)
    assert force == pytest.approx([B * 0.05 - ROOT * 0.2] * M)
    assert end.coupling.down.gain == 1.0
