"""The client's end yields in a gap: a smaller impedance, with every tick's work and all displacement still accounted for."""

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.wave_coupling import WaveCoupling
from cogrip.protocol.line.concealment import YIELDING_GAIN
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import resolve, seat_settings

B = 20.0
ROOT = sqrt(2.0 * B)
T_C, M = 1.0 / 1024.0, 8


class End:
    """A coupling, and what a server would send it."""

    def __init__(self, axes: int = 1, concealment: str = "elastic", encoder: str = "displacement") -> None:
        table = {
            "object": {"axes": axes}, "coupling": {"impedance_nspm": B, "encoder": encoder},
            "playout": {"frames": 2, "concealment": concealment}, "users": [{"name": "anna"}],
        }  # fmt: skip
        self.coupling = WaveCoupling(seat_settings(resolve(table), 0))
        self.line = LineSender(axes, 2)
        self.axes = axes

    def frame(self, wave: float | None, speed_mps: float, sent: float | None = None) -> list[float]:
        """A frame of M ticks at a speed: a wave comes, or none (though `sent` was). Returns the forces of the first axis."""
        value = wave if wave is not None else sent if sent is not None else 0.0
        self.line.push((value,) * self.axes)
        if wave is not None:
            first, waves, total, squares = self.line.contents()
            state = (0.0,) * (2 * self.axes)
            assert self.coupling.receive(Waves(7, first, waves, total, squares, 0.0, 0.0, 0, Stamp(0), state))
        self.coupling.start_frame()
        forces = []
        velocity = [speed_mps] * self.axes
        for _ in range(M):
            force = self.coupling.force(velocity, velocity)
            before_j = self.coupling.port_j
            self.coupling.elapse(velocity, velocity)
            work_j = sum(value * speed_mps for value in force) * T_C
            assert self.coupling.port_j - before_j == pytest.approx(work_j, rel=1e-9, abs=1e-15), (
                "F y = (u^2 - v^2) / 2"
            )
            forces.append(force[0])
        self.coupling.end_frame()
        return forces


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 3), st.sampled_from(["displacement", "velocity"]))
def test_every_tick_gives_the_line_the_work_of_the_law(seed: int, axes: int, encoder: str) -> None:
    end, random = End(axes, encoder=encoder), Random(seed)
    for _ in range(120):
        end.frame(0.3 if random.random() < 0.6 else None, random.uniform(-0.2, 0.2))
    assert end.coupling.count().applied > 0


def moving(concealment: str) -> list[float]:
    """Free motion at 0.1 m/s, v = sqrt(b/2) y and no force; some trouble before, then half a second of nothing."""
    end = End(concealment=concealment)
    wave = sqrt(B / 2.0) * 0.1
    forces = []
    for number in range(200):
        gone = number in (40, 41, 42, 43) or 100 <= number < 164
        forces.append(end.frame(None if gone else wave, 0.1, sent=wave)[-1])
    return forces


def test_a_gap_feels_like_a_sixth_of_the_damping() -> None:
    """b y = 2 N with a matched termination; least_share^2 of it where the end yields. It comes slowly, and goes so too."""
    matched, yielding = moving("zero"), moving("elastic")
    assert matched[160] == pytest.approx(B * 0.1)
    assert yielding[160] == pytest.approx(YIELDING_GAIN**2 * B * 0.1, rel=0.05)
    assert max(abs(after - before) for before, after in pairwise(matched[90:])) > 1.9
    assert max(abs(after - before) for before, after in pairwise(yielding[90:])) < 0.4


def test_what_is_not_sent_in_a_gap_is_written_off_by_the_receiver() -> None:
    """sum u = sqrt(2b) x - sum v - sum e, and the receiver holds e: no displacement is forgotten."""
    end = End()
    wave = sqrt(B / 2.0) * 0.1
    for number in range(66):
        end.frame(None if number in (20, 21) or number >= 60 else wave, 0.1, sent=wave)

    receiver, written_off = end.coupling.down.receiver, []

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

    end.coupling.down.receiver = Listening()  # type: ignore[assignment]
    before, sent, applied = sum(end.coupling.down.written_off) / M, 0.0, 0.0
    for _ in range(30):
        end.frame(None, 0.1, sent=wave)
        sent += end.coupling.sent[0]
        applied += end.coupling.returning[0]
    moved = 30 * ROOT * 0.1
    assert sent + applied < 0.7 * moved
    rest = sum(written_off) - before + sum(end.coupling.down.written_off) / M
    assert sent + applied + rest == pytest.approx(moved, rel=1e-9)


def test_a_clear_line_does_not_yield() -> None:
    end = End(axes=2)
    for _ in range(50):
        force = end.frame(0.2, 0.05)
    assert force == pytest.approx([B * 0.05 - ROOT * 0.2] * M)
    assert end.coupling.down.gain == 1.0
