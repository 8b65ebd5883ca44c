"""Drivers that lie, in whole sessions of virtual time: what they say is not used, the force fades, nobody is kicked."""

from collections.abc import Callable, Sequence
from itertools import pairwise, product
from math import nan
from types import SimpleNamespace

import pytest

from cogrip.devices.device import Sample
from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.room import resolve
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.kinds import schemes_of

RATE_HZ = 1024
BEGIN = 700  # tick at which anna's device begins to lie
AT_ONCE_S = 0.05
HELD = schemes_of("cube")
"""Coupling schemes in which the hand is held wherever it is: in contact alone a jump may leave no force to end."""
HANDS = {"anna": "reach&amplitude_m=0.03&delay_s=0.3&stroke_s=0.6", "ben": "hold"}
Lie = Callable[[int, Sample], Sample]
Report = Callable[[Sequence[float]], Sequence[float] | None]


class Session:
    """Anna, whose driver lies from tick BEGIN on, of samples or of forces; ben, with a device of the same model."""

    def __init__(
        self, kind: Kind, model: str, lie: Lie | None = None, report: Report | None = None, seconds: float = 1.0
    ) -> None:
        users = [{"name": name, "device": model, "hand": hand} for name, hand in HANDS.items()]
        coupling = {"kind": kind, "stiffness_npm": 300.0}
        self.laboratory = Laboratory(
            resolve(
                {
                    "seconds": seconds,
                    "object": {"axes": 1},
                    "coupling": coupling,
                    "users": users,
                }
            )
        )
        self.anna = self.laboratory.people[0]
        self.safety, self.supervised = self.anna.core.safety, self.anna.supervised
        self.forces: list[float] = []
        device = self.anna.device

        def read(tick: int) -> Sample:
            sample = device.read(tick)
            assert sample is not None
            return lie(tick, sample) if lie is not None and tick >= BEGIN else sample

        def write(force_n: Sequence[float]) -> Sequence[float] | None:
            self.forces.append(force_n[0])
            acting = device.write(force_n)
            return report(force_n) if report is not None and len(self.forces) > BEGIN else acting

        verbs = {"open": device.open, "read": read, "write": write, "close": device.close}
        self.anna.device = SimpleNamespace(capability=device.capability, counts={}, **verbs)

    def run(self, watch: Callable[[Laboratory], object] = lambda laboratory: None) -> None:
        self.laboratory.run(watch)

    def largest_step(self, first: int = BEGIN) -> float:
        steps = [abs(new - old) for old, new in pairwise(self.forces)]
        return max(steps[first - 1 :])

    def ends_well(self, words: str, seconds: float = AT_ONCE_S) -> None:
        """A fault that says so; zero force in time; no step above what a fault's fading takes; the other goes on."""
        assert self.safety.state == "fault"
        assert words in self.safety.reason
        held = abs(self.forces[BEGIN - 1])
        assert held > 0.3, "there was a force to end"
        assert not any(self.forces[BEGIN + round(seconds * RATE_HZ) :])
        assert self.largest_step() < 0.5
        assert max(map(abs, self.forces[BEGIN:])) < held + 0.5
        assert self.laboratory.people[1].core.safety.state == "live"
        assert not self.laboratory.incident


def moved_by(by_m: float, every_tick: int = 1) -> Lie:
    def lie(tick: int, sample: Sample) -> Sample:
        return Sample((sample.position_m[0] + (by_m if tick % every_tick == 0 else 0.0),), sample.velocity_mps)

    return lie


MODELS = ("sim:phantom", "sim:ideal")  # the second gives velocity


@pytest.mark.parametrize(("jump_m", "model", "kind"), every(4, product((0.03, -0.005), MODELS, HELD)))
def test_a_position_that_jumps_and_stays(kind: Kind, model: str, jump_m: float) -> None:
    session = Session(kind, model, moved_by(jump_m))
    work_j: list[float] = []
    session.run(lambda laboratory: work_j.append(session.anna.core.ledger.work_j))
    session.ends_well("the position jumped: ")
    assert session.safety.counts["implausible jump"] == 3
    assert abs(work_j[BEGIN + 30] - work_j[BEGIN - 1]) < 2e-3, "no hand has worked over the jump"


@pytest.mark.parametrize("kind", HELD)
def test_re_arming_after_a_jump_is_no_kick(kind: Kind) -> None:
    """The new place is the reference. Before, virtual coupling pulled with 300 N/m over 30 mm."""
    session = Session(kind, "sim:phantom", moved_by(0.03), seconds=1.8)

    def watch(laboratory: Laboratory) -> None:
        if laboratory.tick == BEGIN + 100:
            assert session.supervised.rearm() == ""

    session.run(watch)
    assert session.safety.state == "live"
    assert session.safety.counts["fault"] == 1
    assert session.largest_step(BEGIN + 100) < 0.3
    again, before = session.forces[BEGIN + 100 :], max(map(abs, session.forces[:BEGIN]))
    assert max(map(abs, again[:80])) < 0.3 * before, "it ramps in from nothing"
    assert 0.3 * before < max(map(abs, again)) < 1.5 * before, "as before"


def test_one_odd_sample_is_left_out_and_costs_nothing() -> None:
    session = Session("wave", "sim:phantom", moved_by(0.03, every_tick=20))
    session.run()
    assert session.safety.state == "live"
    assert session.safety.counts["implausible jump"] == len(range(BEGIN, session.laboratory.ticks().run, 20))
    assert session.largest_step() < 0.5


AGES = {
    "as it stalls": (lambda tick: tick, "old sample"),
    "below 0": (lambda tick: -1000, "implausible age"),
    "50": (lambda tick: 50, "implausible age"),
}


@pytest.mark.parametrize(("model", "case"), every(2, product(MODELS, AGES)))
def test_an_age_that_no_sample_has_is_a_stall(model: str, case: str) -> None:
    age, name = AGES[case]
    session = Session(
        "wave", model, lambda tick, sample: Sample(sample.position_m, sample.velocity_mps, age(tick - BEGIN + 1))
    )
    session.run()
    session.ends_well("device stall: more than 20 ms without samples")
    assert session.safety.counts[name] > 15


@pytest.mark.parametrize("speed_mps", [lambda tick: 0.4 * (-1) ** tick, lambda tick: 0.2])
def test_a_position_that_freezes_while_there_is_a_velocity(speed_mps: Callable[[int], float]) -> None:
    frozen: list[tuple[float, ...]] = []

    def lie(tick: int, sample: Sample) -> Sample:
        frozen.append(sample.position_m)
        return Sample(frozen[0], (speed_mps(tick),))

    session = Session("wave", "sim:ideal", lie)
    session.run()
    assert session.safety.state == "fault"
    assert "its positions deny each other" in session.safety.reason
    assert not any(session.forces[BEGIN + round(0.085 * RATE_HZ) :])
    assert session.laboratory.people[1].core.safety.state == "live"


@pytest.mark.parametrize(
    "report",
    [lambda force: (nan,), lambda force: (-50.0 * force[0],), lambda force: (force[0] + 3.0,), lambda force: (force[0],) * 2],
    ids=["nan", "-50 F", "+3 N", "two axes"],
)  # fmt: skip
def test_a_report_of_a_force_that_nobody_asked_for(report: Report) -> None:
    """The ledger holds what was asked, and the force ends."""
    session = Session("wave", "sim:phantom", report=report)
    held: list[float] = []
    session.run(lambda laboratory: held.append(session.anna.core.force_n[0]))
    session.ends_well("acts where (")
    assert session.safety.reason.startswith("device: sim: says that ")
    assert session.supervised.counts["implausible force reported"] >= 3
    assert held == session.forces[: len(held)], "never what it said"
    assert session.safety.counts.get("force limited by the device", 0) <= 1, "-50 x 0"


def test_a_part_of_the_force_is_believed() -> None:
    session = Session("wave", "sim:phantom", report=lambda force_n: (0.5 * force_n[0],), seconds=1.5)
    session.run()
    assert session.safety.state == "live"
    assert session.safety.counts["force limited by the device"] > 700


@pytest.mark.parametrize(
    "lie",
    [
        lambda tick, sample: Sample((0.0, 0.0), None),
        lambda tick, sample: Sample((), None),
        lambda tick, sample: Sample(sample.position_m, (0.0, 0.0)),
        lambda tick, sample: Sample((None,), None),
        lambda tick, sample: Sample(sample.position_m, None, 0.5),
        lambda tick, sample: 7,
        lambda tick, sample: [][0],
    ],
    ids=["two axes", "none", "velocity", "no number", "age", "no sample", "an error"],
)
def test_what_is_no_sample_is_a_fault_and_no_traceback(lie: Lie) -> None:
    session = Session("wave", "sim:phantom", lie)
    session.run()
    session.ends_well("device: sim: ")
