"""Drivers that lie, in whole sessions of virtual time: what they say is not used, the force fades, nobody is kicked."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise, product
from math import nan

import pytest

from cogrip.devices.device import Capability, Device, Sample
from cogrip.devices.registry import make
from cogrip.protocol.settings import resolve
from cogrip.sim.session.laboratory import Laboratory, Person

from tests.extent import every

RATE_HZ = 1024
BEGIN = 700  # tick at which anna's device begins to lie
AT_ONCE_S = 0.05
HANDS = ("reach&amplitude_m=0.03&delay_s=0.3&stroke_s=0.6", "hold")
Lie = Callable[[int, Sample], Sample]
Report = Callable[[Sequence[float]], Sequence[float] | None]


class Liar:
    """A simulated device, and what its driver makes of its samples and forces from tick BEGIN on."""

    def __init__(self, address: str, lie: Lie | None = None, report: Report | None = None, end: int = 10**9) -> None:
        self._device: Device = make(address)
        self._lie, self._report, self._end = lie, report, end
        self.tick = 0
        self.forces: list[float] = []

    @property
    def capability(self) -> Capability:
        return self._device.capability

    @property
    def counts(self) -> Mapping[str, int]:
        return {}

    def open(self, rate_hz: int) -> None:
        self._device.open(rate_hz)

    def read(self, tick: int) -> Sample | None:
        self.tick = tick
        sample = self._device.read(tick)
        assert sample is not None
        return self._lie(tick, sample) if self._lie is not None and BEGIN <= tick < self._end else sample

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        self.forces.append(force_n[0])
        acting = self._device.write(force_n)
        return self._report(force_n) if self._report is not None and BEGIN <= self.tick < self._end else acting

    def close(self) -> None:
        self._device.close()


def session(
    kind: str, model: str, liar: Callable[[str], Liar], seconds: float = 1.0
) -> tuple[Laboratory, Person, Liar]:
    """Anna with a liar, ben with a device of the same model."""
    settings = resolve(
        {
            "seconds": seconds,
            "object": {"axes": 1},
            "coupling": {"kind": kind, "stiffness_npm": 300.0},
            "users": [
                {"name": name, "device": model, "hand": hand} for name, hand in zip(("anna", "ben"), HANDS, strict=True)
            ],
        }
    )
    laboratory = Laboratory(settings)
    anna = laboratory.people[0]
    device = liar(f"{model}?hand={HANDS[0]}")
    anna.device = device
    anna.supervised.open()
    return laboratory, anna, device


def largest_step(forces: Sequence[float], first: int = BEGIN) -> float:
    steps = [abs(new - old) for old, new in pairwise(forces)]
    return max(steps[first - 1 :])


def ends_well(laboratory: Laboratory, anna: Person, device: Liar, words: str, seconds: float = AT_ONCE_S) -> None:
    """A fault that says so; zero force in time; no step above what a fault's fading takes; the other goes on."""
    assert anna.core.safety.state == "fault"
    assert words in anna.core.safety.reason
    held = abs(device.forces[BEGIN - 1])
    assert held > 0.3, "there was a force to end"
    assert not any(device.forces[BEGIN + round(seconds * RATE_HZ) :])
    assert largest_step(device.forces) < 0.5
    assert max(map(abs, device.forces[BEGIN:])) < held + 0.5
    assert laboratory.people[1].core.safety.state == "live"
    assert not laboratory.diverged


MODELS = ("sim:phantom", "sim:ideal")  # the second gives velocity


@pytest.mark.parametrize(
    ("jump_m", "model", "kind"), every(4, product((0.03, -0.005), MODELS, ("wave", "coupling", "tdpa")))
)
def test_a_position_that_jumps_and_stays(kind: str, model: str, jump_m: float) -> None:
    def lie(tick: int, sample: Sample) -> Sample:
        return Sample((sample.position_m[0] + jump_m,), sample.velocity_mps)

    laboratory, anna, device = session(kind, model, lambda address: Liar(address, lie))
    work_j: list[float] = []
    laboratory.run(lambda lab: work_j.append(anna.core.ledger.work_j))
    ends_well(laboratory, anna, device, "the position jumped: ")
    assert anna.core.safety.counts["implausible jump"] == 3
    assert abs(work_j[BEGIN + 30] - work_j[BEGIN - 1]) < 2e-3, "no hand has worked over the jump"


@pytest.mark.parametrize("kind", ["wave", "coupling", "tdpa"])
def test_re_arming_after_a_jump_is_no_kick(kind: str) -> None:
    """The new place is the reference. Before, virtual coupling pulled with 300 N/m over 30 mm."""

    def lie(tick: int, sample: Sample) -> Sample:
        return Sample((sample.position_m[0] + 0.03,), None)

    laboratory, anna, device = session(kind, "sim:phantom", lambda address: Liar(address, lie), 1.8)

    def watch(lab: Laboratory) -> None:
        if lab.tick == BEGIN + 100:
            assert anna.supervised.rearm() == ""

    laboratory.run(watch)
    assert anna.core.safety.state == "live"
    assert anna.core.safety.counts["fault"] == 1
    assert largest_step(device.forces, BEGIN + 100) < 0.3
    again, before = device.forces[BEGIN + 100 :], max(map(abs, device.forces[:BEGIN]))
    assert max(map(abs, again[:80])) < 0.3 * before, "it ramps in from nothing"
    assert 0.3 * before < max(map(abs, again)) < 1.5 * before, "as before"


def test_one_odd_sample_is_left_out_and_costs_nothing() -> None:
    def lie(tick: int, sample: Sample) -> Sample:
        return Sample((sample.position_m[0] + (0.03 if tick % 20 == 0 else 0.0),), None)

    laboratory, anna, device = session("wave", "sim:phantom", lambda address: Liar(address, lie))
    laboratory.run()
    assert anna.core.safety.state == "live"
    assert anna.core.safety.counts["implausible jump"] == len(range(BEGIN, laboratory.ticks().run, 20))
    assert largest_step(device.forces) < 0.5


AGES = {
    "as it stalls": (lambda tick: tick, "old sample"),
    "below 0": (lambda tick: -1000, "implausible age"),
    "50": (lambda tick: 50, "implausible age"),
}


@pytest.mark.parametrize(("model", "case"), every(2, product(MODELS, AGES)))
def test_an_age_that_no_sample_has_is_a_stall(model: str, case: str) -> None:
    age, name = AGES[case]

    def lie(tick: int, sample: Sample) -> Sample:
        return Sample(sample.position_m, sample.velocity_mps, age(tick - BEGIN + 1))

    laboratory, anna, device = session("wave", model, lambda address: Liar(address, lie))
    laboratory.run()
    ends_well(laboratory, anna, device, "device stall: more than 20 ms without samples")
    assert anna.core.safety.counts[name] > 15


@pytest.mark.parametrize("speed_mps", [lambda tick: 0.4 * (-1) ** tick, lambda tick: 0.2])
def test_a_position_that_freezes_while_there_is_a_velocity(speed_mps: Callable[[int], float]) -> None:
    frozen: list[tuple[float, ...]] = []

    def lie(tick: int, sample: Sample) -> Sample:
        frozen.append(sample.position_m)
        return Sample(frozen[0], (speed_mps(tick),))

    laboratory, anna, device = session("wave", "sim:ideal", lambda address: Liar(address, lie))
    laboratory.run()
    assert anna.core.safety.state == "fault"
    assert "its positions deny each other" in anna.core.safety.reason
    assert not any(device.forces[BEGIN + round(0.085 * RATE_HZ) :])
    assert laboratory.people[1].core.safety.state == "live"


@pytest.mark.parametrize(
    "report",
    [lambda force: (nan,), lambda force: (-50.0 * force[0],), lambda force: (force[0] + 3.0,), lambda force: (force[0],) * 2],
    ids=["nan", "-50 F", "+3 N", "two axes"],
)  # fmt: skip
def test_a_report_of_a_force_that_nobody_asked_for(report: Report) -> None:
    """The ledger holds what was asked, and the force ends."""
    laboratory, anna, device = session("wave", "sim:phantom", lambda address: Liar(address, None, report))
    held: list[float] = []
    laboratory.run(lambda lab: held.append(anna.core.force_n[0]))
    ends_well(laboratory, anna, device, "acts where (")
    assert anna.core.safety.reason.startswith("device: sim: says that ")
    assert anna.supervised.counts["implausible force reported"] >= 3
    assert held == device.forces[: len(held)], "never what it said"
    assert anna.core.safety.counts.get("force limited by the device", 0) <= 1, "-50 x 0"


def test_a_part_of_the_force_is_believed() -> None:
    laboratory, anna, _ = session(
        "wave", "sim:phantom", lambda address: Liar(address, None, lambda f: (0.5 * f[0],)), 1.5
    )
    laboratory.run()
    assert anna.core.safety.state == "live"
    assert anna.core.safety.counts["force limited by the device"] > 700


@pytest.mark.parametrize(
    "lie",
    [
        lambda tick, sample: Sample((0.0, 0.0), None),
        lambda tick, sample: Sample((), None),
        lambda tick, sample: Sample(sample.position_m, (0.0, 0.0)),
        lambda tick, sample: Sample((None,), None),
        lambda tick, sample: Sample(sample.position_m, None, 0.5),
        lambda tick, sample: 7,
    ],
    ids=["two axes", "none", "velocity", "no number", "age", "no sample"],
)
def test_what_is_no_sample_is_a_fault_and_no_traceback(lie: Lie) -> None:
    laboratory, anna, device = session("wave", "sim:phantom", lambda address: Liar(address, lie))
    laboratory.run()
    ends_well(laboratory, anna, device, "device: sim: ")


@pytest.mark.parametrize("error", [OSError("gone"), IndexError("list index out of range"), ValueError()])
def test_whatever_a_driver_raises_names_it(error: Exception) -> None:
    def lie(tick: int, sample: Sample) -> Sample:
        raise error

    laboratory, anna, device = session("wave", "sim:phantom", lambda address: Liar(address, lie, end=BEGIN + 100))
    refusals: list[str] = []
    laboratory.run(lambda lab: refusals.append(anna.supervised.rearm()) if lab.tick == BEGIN + 50 else None)
    ends_well(laboratory, anna, device, f"device: sim: {type(error).__name__}")
