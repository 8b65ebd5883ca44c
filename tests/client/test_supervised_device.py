"""A supervised device: a failure is a latched fault, and re-arming waits for steady samples."""

from dataclasses import replace
from itertools import count, islice
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cogrip.client.inputs import ClientInput, DeviceFailed, DeviceOpened, ForceApplied, Rearm
from cogrip.client.safety.limiter import FAULT_OUT_S
from cogrip.client.supervised_device import ARMING_S, MOST_GAP_TICKS, SETTLED_S, SupervisedDevice
from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.registry import make

from tests.client.live_safety import live
from tests.devices.arm_bench import opened

RATE_HZ = 1000
SETTLED = round(SETTLED_S * RATE_HZ)
ARMING = round(ARMING_S * RATE_HZ)
RECORD = make("sim:phantom").capability
HERE = Sample((0.01,), None)


class Core:
    """The part of a core that a supervised device uses."""

    def __init__(self, capability: Capability = RECORD) -> None:
        self.capability, self.now_ns = capability, 0
        self.safety = live(capability, 1.0 / RATE_HZ)
        self.equipped: list[Capability] = []
        self.acting: list[tuple[float, ...]] = []

    def handle(self, given: ClientInput, now_ns: int) -> None:
        match given:
            case DeviceFailed(reason):
                self.safety.fail(reason)
            case Rearm():
                assert self.safety.event("rearm")
                assert self.safety.event("go")
            case DeviceOpened(capability):
                self.equipped.append(capability)
            case ForceApplied(force_n):
                self.acting.append(force_n)
                self.safety.applied(force_n)


class Scripted:
    """A device that does what it is told: `sample` or `error`, and `given` for the force that acts."""

    def __init__(self) -> None:
        self.capability = self.when_open = RECORD
        self.sample: Sample | None = HERE
        self.error = self.refused = ""
        self.given: tuple[float, ...] | None = None
        self.calls: list[object] = []

    def _fail(self, error: str) -> None:
        if error:
            raise DeviceError(error)

    def open(self, rate_hz: int) -> None:
        self.calls.append(("open", rate_hz))
        self._fail(self.refused)
        self.capability = self.when_open

    def read(self, tick: int) -> Sample | None:
        self._fail(self.error)
        return self.sample

    def write(self, force_n: tuple[float, ...]) -> tuple[float, ...] | None:
        self.calls.append(force_n)
        self._fail(self.error)
        return self.given

    def close(self) -> None:
        self.calls.append("close")


class Held:
    """Device and core under supervision, a tick at a time."""

    def __init__(self) -> None:
        self.device, self.core = Scripted(), Core()
        self.safety = self.core.safety
        self.supervised = SupervisedDevice(self.device, self.core, RATE_HZ)  # type: ignore[arg-type]
        self.tick = 0
        self.run(400)
        self.device.calls.clear()

    @property
    def state(self) -> str:
        return self.safety.state

    def fail(self, reason: str) -> None:
        """A fault that is not the device's."""
        self.core.handle(DeviceFailed(reason), self.core.now_ns)

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.supervised.read(self.tick)
            self.supervised.write(self.safety.limit((1.0,)))
            self.tick += 1


@pytest.fixture
def held() -> Held:
    return Held()


def test_the_core_goes_by_the_record_of_a_device_that_is_open(held: Held) -> None:
    held.supervised.open()
    assert held.core.equipped == [RECORD]
    weaker = held.device.when_open = replace(RECORD, peak_force_n=2.0)
    held.supervised.open()
    assert held.core.equipped == [RECORD, weaker]
    assert held.device.calls == [("open", RATE_HZ)] * 2


@pytest.mark.parametrize(
    "given", [((0.01,), None), SimpleNamespace(position_m=(0.01,), velocity_mps=None, age_ticks=0)]
)
def test_what_is_no_sample_is_a_fault_that_says_so(held: Held, given: Any) -> None:
    held.device.sample = given
    held.run(1)
    assert held.safety.state == "fault"
    assert "which is no Sample; correct its driver" in held.safety.reason


def test_only_open_raises(held: Held) -> None:
    held.device.error = held.device.refused = "the wire is gone"
    held.run(1)
    assert held.supervised.rearm() == "the wire is gone"
    with pytest.raises(DeviceError, match="the wire is gone"):
        held.supervised.open()


@pytest.mark.parametrize(("verb", "argument"), [("read", 400), ("write", (1.0,))])
def test_a_failure_is_a_fault_with_its_first_reason(held: Held, verb: str, argument: object) -> None:
    held.device.error = "lost: unplugged"
    getattr(held.supervised, verb)(argument)
    held.device.error = "is closed"
    held.run(3)
    assert held.state == "fault"
    assert held.safety.reason == "device: lost: unplugged"
    assert held.safety.counts["fault"] == 1


@pytest.mark.parametrize("number", [int, np.float64, np.float32])
def test_numbers_of_other_types_become_floats(held: Held, number: type) -> None:
    """A recording holds floats, and numpy's numbers are no JSON."""
    held.device.sample = Sample((number(0),), None)
    sample = held.supervised.read(held.tick)
    assert sample is not None
    assert [type(part) for part in sample.position_m] == [float]


def test_a_failed_device_gets_the_force_that_fades_and_is_then_closed(held: Held) -> None:
    """The device may still be reached; to calibrate it, others must be able to open it."""
    held.device.error = "encoder b is stuck"
    held.run(40)
    calls = held.device.calls
    last = calls.index((0.0,))
    assert calls[:last] == sorted(calls[:last], reverse=True)
    assert 10 < last + 1 <= 22, "over 20 ms"
    assert calls.index("close") > last


def test_the_force_applied_is_reported_to_the_core(held: Held) -> None:
    for held.device.given, reported in ((None, []), ((0.25,), [(0.25,)])):
        held.run(1)
        assert held.core.acting == reported


def test_re_arming_without_a_fault_does_nothing(held: Held) -> None:
    assert held.supervised.rearm() == ""
    held.run(2 * SETTLED)
    assert held.state == "live"
    held.fail("later")
    held.run(2 * SETTLED)
    assert held.state == "fault", "it was not asked of this fault"
    assert ("open", RATE_HZ) not in held.device.calls


def test_a_device_that_did_not_fail_is_not_opened_anew(held: Held) -> None:
    held.fail("over-speed")
    held.run(30)
    assert held.supervised.rearm() == ""
    held.run(SETTLED)
    assert held.state == "fault"
    held.run(1)
    assert held.state == "live"
    assert not {"close", ("open", RATE_HZ)} & {*held.device.calls}


def test_a_device_that_failed_is_opened_anew(held: Held) -> None:
    held.device.error, held.device.refused = "unplugged", "is not there; plug it in"
    held.run(50)
    for _ in range(2):
        assert held.supervised.rearm() == "is not there; plug it in"
        held.run(2 * SETTLED)
        assert held.state == "fault"
    held.device.error = held.device.refused = ""
    assert held.supervised.rearm() == ""
    held.tick += 300  # opening took its time: what comes first says nothing about the loop
    held.run(SETTLED + 1)
    assert held.state == "live"
    assert held.safety.limit((1.0,))[0] < 0.01, "force ramps in from nothing"
    held.device.calls.clear()
    held.run(2)
    assert "close" not in held.device.calls


@pytest.mark.parametrize(("gap", "state"), [(MOST_GAP_TICKS - 1, "live"), (MOST_GAP_TICKS, "fault")])
def test_samples_must_come_without_a_gap(held: Held, gap: int, state: str) -> None:
    held.fail("device stall")
    held.supervised.rearm()
    for held.device.sample, ticks in ((HERE, SETTLED // 2), (None, gap), (HERE, SETTLED + 1 - SETTLED // 2 - gap)):
        held.run(ticks)
    assert held.state == state
    held.run(SETTLED)
    assert held.state == "live"


def test_a_device_that_stays_silent_is_given_up(held: Held) -> None:
    held.fail("device stall")
    held.device.sample = None
    held.supervised.rearm()
    held.run(ARMING + 1)
    assert held.supervised.refusal == ""
    held.run(1)
    assert "no steady samples within 1 s" in held.supervised.refusal
    held.device.sample = HERE
    held.run(2 * SETTLED)
    assert held.state == "fault", "it was given up"
    assert held.supervised.rearm() == held.supervised.refusal == ""
    held.run(SETTLED + 1)
    assert held.state == "live"


def test_a_device_that_fails_while_it_is_armed_says_why(held: Held) -> None:
    held.device.error = "encoder a jumped"
    held.run(50)
    held.device.error = ""
    assert held.supervised.rearm() == ""
    for held.device.error, ticks in (("", 3), ("the tip is outside its workspace", 1), ("", 2 * SETTLED)):
        held.run(ticks)
    assert held.supervised.refusal == "the tip is outside its workspace"
    assert held.safety.reason == "device: encoder a jumped", "the fault is still the same"
    assert held.state == "fault"


def test_a_clock_finds_calls_that_block(held: Held) -> None:
    """A third of all calls may be twice too long, not more; opening anew clears the count."""
    now_ns, every = 0, 3

    def read(tick: int) -> Sample:
        nonlocal now_ns
        now_ns += 2 * 1_000_000_000 // RATE_HZ if tick % every == 0 else 0
        return HERE

    held.device.read = read  # type: ignore[method-assign]
    held.supervised = SupervisedDevice(held.device, held.core, RATE_HZ, lambda: now_ns)  # type: ignore[arg-type]
    held.run(1000)
    assert held.state == "live"
    assert held.supervised.counts["slow read"] == pytest.approx(333, abs=1)
    every = 2
    held.run(1000)
    assert held.state == "fault"
    assert held.safety.reason.startswith("device: sim: its read took 2.0 ms, and a tick has 1 ms")
    every = 3
    assert held.supervised.rearm() == ""
    held.run(SETTLED + 1)
    assert held.state == "live"


@pytest.mark.parametrize("verb", ["reply", "port.read"])
def test_an_arm_whose_replies_are_lost_is_asked_for_no_force_and_closed(verb: str, monkeypatch) -> None:
    """Its last request still waits for an answer, so the driver says that the force of that one acts, for ever."""
    bench = opened(axes=1)
    core = Core(bench.capability)
    supervised = SupervisedDevice(bench, core, RATE_HZ)
    ticks = count(1)

    def run(number: int, wish: tuple[float, ...] | None) -> None:
        for tick in islice(ticks, number):
            supervised.read(tick)
            supervised.write(core.safety.limit(wish))

    def lost(*arguments: object) -> bytes:
        raise DeviceError("serial:/dev/test: lost: Input/output error")

    run(400, (0.5,))
    assert abs(bench.force_n[0]) > 0.4
    exchange = bench.driver.exchange
    monkeypatch.setattr(exchange if verb == "reply" else exchange.port, verb.removeprefix("port."), lost)
    run(1, (0.5,))
    assert core.safety.state == "fault"
    run(round((FAULT_OUT_S + 0.02) * RATE_HZ), None)
    assert core.safety.quiet
    assert bench.force_n == pytest.approx((0.0,), abs=1e-9)
