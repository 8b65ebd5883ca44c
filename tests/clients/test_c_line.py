"""A line of the client in C: the vectors of SPEC.md, the invariant on any network, and the counts of every frame."""

import json
from ctypes import c_double, c_int64
from random import Random
from typing import Any

import pytest
from msgspec.structs import asdict

from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender

from tests.clients.compiled import needs_compiler
from tests.extent import every
from tests.protocol.spec_page import rows, section

pytestmark = needs_compiler

FRAME_S, M, AUTO = 1 / 128, 8, -1
CONCEALMENTS = ("zero", "repaid", "tank", "elastic")
STATE = (
    "hold", "played", "cursor", "repeated", "skipped", "sent", "received", "applied", "lost", "late", "duplicate", "pending",
)  # fmt: skip
Contents = tuple[int, tuple[float, ...], tuple[float, ...], tuple[float, ...]]


class CLine:
    """Sender and receiver of one axis, as `LineSender` and `LineReceiver` are."""

    def __init__(
        self, library: Any, frames: int, redundancy: int, *, ticks: int = M, late: float = 0.01, credit_j: float = 0.0,
        concealment: str = "tank",
    ) -> None:  # fmt: skip
        self._library = library
        library.probe_line(frames, redundancy, ticks, late, credit_j, CONCEALMENTS.index(concealment))

    def push(self, wave: float) -> None:
        self._library.probe_push(wave)

    def contents(self) -> Contents:
        first, waves, total, squares = c_int64(), (c_double * 32)(), c_double(), c_double()
        count = self._library.probe_contents(first, waves, total, squares)
        return first.value, tuple(waves[:count]), (total.value,), (squares.value,)

    def receive(
        self, first: int, waves: tuple[float, ...], total: tuple[float], squares: tuple[float], early: int = 0
    ) -> bool:
        return bool(
            self._library.probe_take(first, len(waves), (c_double * len(waves))(*waves), *total, *squares, early)
        )

    def pop(self) -> float:
        wave: float = self._library.probe_pop()
        return wave

    @property
    def state(self) -> dict[str, int]:
        values = (c_int64 * len(STATE))()
        self._library.probe_state(values)
        return dict(zip(STATE, values, strict=True))


def test_a_line_plays_the_vector(library: Any) -> None:
    line = CLine(library, frames=1, redundancy=2)
    for _, wave, first, waves, total, squares, played, counts in rows(section("15.4"), "frame"):
        line.push(float(wave))
        if first != "-":
            contents = (int(first), tuple(json.loads(waves)), (float(total),), (float(squares),))
            assert line.contents() == contents
            assert line.receive(*contents)
        assert line.pop() == pytest.approx(float(played), abs=1e-15)
        assert [line.state[name] for name in ("sent", "applied", "late", "lost")] == [
            int(each) for each in counts.split()
        ]


def test_the_playout_delay_adapts_as_the_vector_says(library: Any) -> None:
    line = CLine(library, frames=AUTO, redundancy=2)
    sent: list[Contents] = []
    flight: dict[int, list[int]] = {}
    tick = border = played = 0
    for frames, delay, offset, moves in rows(section("15.7"), "frames"):
        last = int(frames.split(" to ")[1])
        while len(sent) <= last or tick % M:
            if tick % M == 0:
                line.push(1.0)
                sent.append(line.contents())
                if delay != "-":
                    flight.setdefault(tick + int(delay), []).append(len(sent) - 1)
            for number in flight.pop(tick, []):
                assert line.receive(*sent[number], early=border - tick)
            if tick >= border:
                line.pop()
                state = line.state
                border = tick + state["hold"]
                if state["played"]:
                    played = tick - (state["cursor"] - 1) * M
            tick += 1
        assert (played, line.state["repeated"], line.state["skipped"]) == (int(offset), *map(int, moves.split())), (
            frames
        )


@pytest.mark.sample(6)
@pytest.mark.parametrize("seed", every(4, range(24)))
@pytest.mark.parametrize("concealment", CONCEALMENTS)
def test_no_network_gets_more_out_than_went_in_and_every_frame_has_one_fate(
    library: Any, seed: int, concealment: str
) -> None:
    """SPEC 5.4 at every pop, against the waves themselves; the sums are the reference's to the last bit."""
    random = Random(seed)
    redundancy, frames = random.choice([1, 2, 8, 32]), random.choice([AUTO, 0, 1, 3])
    credit_j, loss, jitter = random.choice([0.0, 1e-3]), random.choice([0.0, 0.1, 0.6]), random.choice([0, 3, 40])
    line = CLine(library, frames, redundancy, credit_j=credit_j, concealment=concealment)
    sender = LineSender(1, redundancy)
    credit, squares, played, came = 2.0 * credit_j / FRAME_S, [0.0], 0.0, 0
    assert library.probe_credit() == pytest.approx(credit)
    flight: dict[int, list[Contents]] = {}
    border = wave = 0.0
    for tick in range(600 * M):
        if tick % M == 0:
            wave = 0.9 * wave + random.gauss(0.0, 1.0)
            sender.push((wave,))
            line.push(wave)
            assert line.contents() == sender.contents()
            squares.append(squares[-1] + wave * wave)
            for _ in range(random.choice([1, 1, 1, 2])):
                if random.random() >= loss:
                    flight.setdefault(tick + random.randint(0, jitter), []).append(sender.contents())
        for contents in flight.pop(tick, []):
            assert line.receive(*contents, early=max(0, int(border - tick)))
            came += 1
        if tick >= border:
            popped = line.pop()
            state = line.state
            border = tick + state["hold"]
            played += popped * popped * state["hold"] / M
            assert played <= squares[max(0, state["cursor"])] + credit + 1e-9 * squares[-1]
            assert state["sent"] == state["applied"] + state["late"] + state["lost"]
    assert came
    assert line.state["received"] <= 600


@pytest.mark.parametrize("frames", [AUTO, 0, 2])
def test_it_is_the_reference_on_a_line_with_losses(library: Any, frames: int) -> None:
    """`tank` is the same rule at both: what is played, what moves, what is counted."""
    random = Random(frames)
    line, sender = CLine(library, frames, 2, credit_j=1e-3), LineSender(1, 2)
    receiver = LineReceiver(1, "auto" if frames == AUTO else frames, FRAME_S, 1e-3, "tank", ticks=M)
    for _ in range(1500):
        sender.push((random.gauss(0.0, 1.0),))
        for _ in range(random.choice([0, 0, 1, 1, 1, 1, 2])):
            assert line.receive(*sender.contents())
            assert receiver.receive(*sender.contents())
        assert line.pop() == pytest.approx(receiver.pop()[0], abs=1e-12)
        assert line.state["hold"] == receiver.hold
    assert line.state.items() >= asdict(receiver.count()).items()
    assert line.state["lost"] > 0


@pytest.mark.parametrize("spare_j", [0.0, 1e-3, 1.0])
@pytest.mark.parametrize("ticks", [7, 8, 11, 15])
def test_a_longer_frame_has_no_more_energy_than_the_port_has_earned(library: Any, ticks: int, spare_j: float) -> None:
    """SPEC 5.7: the sum of M + k ticks over M may have more energy than they had; what is too much is sent later."""
    wave, withheld = 2.0 * ticks / M, c_double()
    going_j = library.probe_end_frame(2.0, ticks, 1, spare_j, withheld)
    assert going_j == pytest.approx(min(0.5 * FRAME_S * wave**2, spare_j))
    assert withheld.value == pytest.approx(wave - (2.0 * going_j / FRAME_S) ** 0.5, abs=1e-12)
    for _ in range(400):
        library.probe_end_frame(0.0, M, 0, 1.0, withheld)
    assert withheld.value == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("first", "count", "fits"), [(16383, 2, True), (16384, 2, False), (0, 32, True)])
def test_a_line_begins_within_reach(library: Any, first: int, count: int, fits: bool) -> None:
    line = CLine(library, 0, 8)
    assert line.receive(first, (0.5,) * count, (0.0,), (0.0,)) is fits


def test_frames_beyond_what_is_remembered_are_unfit(library: Any) -> None:
    line = CLine(library, 0, 1)
    for first, count, fits in ((5, 1, True), (5 + 1025, 1, False), (5 + 1024, 1, True), (0, 33, False)):
        assert line.receive(first, (0.5,) * count, (0.0,), (0.0,)) is fits
    line.pop()
    assert line.state["cursor"] == 1030
    assert not line.receive(1030 + 1025, (0.5,), (0.0,), (0.0,))
