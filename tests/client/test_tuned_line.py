"""The client's end while impedance and filter change: every tick's work goes into the line, and the hand hardly feels it."""

from math import sqrt
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.line_tuner import GENTLE, RATE, LineTuner
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.line_tuning import FOLLOW_S, Tuning
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import resolve, seat_settings

T_C, M, T_N = 1.0 / 1024.0, 8, 1.0 / 128.0


class End:
    """A coupling, and a server that answers with whatever wave it is told, made with whatever impedance."""

    def __init__(self, latency: int = 0, **coupling: object) -> None:
        table = {
            "coupling": {"impedance_nspm": "auto", "wave_filter_hz": "auto", **coupling}, "playout": {"frames": 0},
            "users": [{"name": "anna"}],
        }  # fmt: skip
        self.coupling = WaveCoupling(seat_settings(resolve(table), 0))
        self.coupling.set_latency(latency)
        self.line = LineSender(1, 2)
        self.made_j = 0.0
        self.b, self.since = 20.0, 0

    def answer(self, wave: float, b: float) -> None:
        if b != self.b:
            self.b, self.since = b, self.line.next_number
        self.line.push((wave,))
        self.made_j += 0.5 * T_N * wave * wave
        first, waves, total, squares = self.line.contents()
        sent = Waves(
            7, first, waves, total, squares, self.made_j, 0.0, 0, Stamp(0), (0.0, 0.0), 0, 0, self.b, self.since
        )
        assert self.coupling.receive(sent)

    def frame(self, speed_mps: float) -> list[float]:
        """Run a frame at a speed. Returns the forces."""
        forces = []
        self.coupling.start_frame()
        for _ in range(M):
            (force,) = self.coupling.force([0.0], [speed_mps])
            before_j = self.coupling.port_j
            self.coupling.elapse([speed_mps], [speed_mps])
            if not self.coupling.late:
                assert self.coupling.port_j - before_j == pytest.approx(force * speed_mps * T_C, rel=1e-9, abs=1e-13)
            forces.append(force)
        self.coupling.end_frame()
        return forces


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
    assert end.coupling.returning == pytest.approx((0.5 + end.coupling.down.receiver._concealment._compensation[0],))


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
        message = end.coupling.message(7, Stamp(0), (0.0,), (0.0,), (0.0,))
        assert (message.impedance_nspm, message.since) == ((20.0, 0) if number < 2 else (10.0, 2))
        if number == 1:
            end.coupling.tune(Tuning(10.0, 0.0))
    fixed = End(impedance_nspm=15.0, wave_filter_hz=0.0)
    fixed.frame(0.1)
    message = fixed.coupling.message(7, Stamp(0), (0.0,), (0.0,), (0.0,))
    assert (message.impedance_nspm, message.since) == (0.0, 0)


def metered(frames: int) -> LoopMeter:
    meter = LoopMeter(128)
    for _ in range(128):
        meter.add(frames)
    return meter


@pytest.mark.parametrize(("frames", "redundancy"), [(80, 8), (5, 8), (80, 20)])
def test_a_tuner_goes_in_small_steps(frames: int, redundancy: int) -> None:
    """b at most once in R frames, and as slowly as the loop is followed; S by GENTLE of S + T_n, and RATE of the time."""
    table = {
        "coupling": {"impedance_nspm": "auto", "wave_filter_hz": "auto"}, "link": {"delay_ms": 150.0},
        "playout": {"redundancy": redundancy}, "users": [{}],
    }  # fmt: skip
    tuner, meter = LineTuner(seat_settings(resolve(table), 0)), metered(frames)
    tuner.carried_nspm = 30.0
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
    table = {"coupling": {"impedance_nspm": "auto"}, "link": {"delay_ms": 145.0}, "users": [{}]}
    tuner = LineTuner(seat_settings(resolve(table), 0))
    tuner.carried_nspm = carried
    assert tuner.begin().impedance_nspm == pytest.approx(b, rel=0.02)


def test_a_number_stays_beside_what_is_automatic() -> None:
    base = {"link": {"delay_ms": 300.0}, "users": [{}]}
    for coupling, which in (({"impedance_nspm": "auto"}, 0), ({"wave_filter_hz": "auto"}, 1)):
        tuner = LineTuner(seat_settings(resolve({**base, "coupling": coupling}), 0))
        tuner.carried_nspm = 30.0
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
