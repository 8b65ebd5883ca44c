"""A device in a core's hand: what fails in it is a latched fault, and re-arming waits until it is really back."""

from dataclasses import replace

import pytest

from cogrip.client.inputs import ClientInput, DeviceFailed, DeviceOpened, ForceApplied, Rearm
from cogrip.client.safety import Safety
from cogrip.client.supervised_device import ARMING_S, MOST_GAP_TICKS, SETTLED_S, SupervisedDevice
from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.registry import make

RATE_HZ = 1000
SETTLED = round(SETTLED_S * RATE_HZ)
ARMING = round(ARMING_S * RATE_HZ)
RECORD = make("sim:phantom").capability
HERE = Sample((0.01,), None)


class Core:
    """What a handle knows of a core."""

    def __init__(self) -> None:
        self.capability, self.now_ns = RECORD, 0
        self.safety = Safety(RECORD, 1.0 / RATE_HZ)
        for event in ("open", "calibrated", "go"):
            self.safety.event(event)
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


class Scripted:
    """A device that does what it is told: `sample` or `error`, and `given` for the force that acts."""

    def __init__(self) -> None:
        self.capability = RECORD
        self.when_open = RECORD
        self.sample: Sample | None = HERE
        self.error = self.refused = ""
        self.given: tuple[float, ...] | None = None
        self.calls: list[object] = []

    def open(self, rate_hz: int) -> None:
        self.calls.append(("open", rate_hz))
        if self.refused:
            raise DeviceError(self.refused)
        self.capability = self.when_open

    def read(self, tick: int) -> Sample | None:
        if self.error:
            raise DeviceError(self.error)
        return self.sample

    def write(self, force_n: tuple[float, ...]) -> tuple[float, ...] | None:
        self.calls.append(force_n)
        if self.error:
            raise DeviceError(self.error)
        return self.given

    def close(self) -> None:
        self.calls.append("close")


class Held:
    """Device, core and handle, a tick at a time."""

    def __init__(self) -> None:
        self.device, self.core = Scripted(), Core()
        self.handle = SupervisedDevice(self.device, self.core, RATE_HZ)  # type: ignore[arg-type]
        self.tick = 0
        self.run(400)
        self.device.calls.clear()

    @property
    def state(self) -> str:
        return self.core.safety.state

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.handle.read(self.tick)
            self.handle.write(self.core.safety.limit((1.0,)))
            self.tick += 1


@pytest.fixture
def held() -> Held:
    return Held()


def test_a_device_that_knows_its_limits_only_when_open_is_believed(held: Held) -> None:
    held.handle.open()
    assert held.core.equipped == []
    weaker = held.device.when_open = replace(RECORD, peak_force_n=2.0)
    held.handle.open()
    assert held.core.equipped == [weaker]
    assert held.device.calls == [("open", RATE_HZ)] * 2


def test_only_open_raises(held: Held) -> None:
    held.device.error = held.device.refused = "the wire is gone"
    assert held.handle.read(held.tick) is None
    held.handle.write((0.5,))
    assert held.handle.rearm() == "the wire is gone"
    with pytest.raises(DeviceError, match="the wire is gone"):
        held.handle.open()


def test_a_failure_is_a_fault_with_its_first_reason(held: Held) -> None:
    held.device.error = "lost: unplugged"
    held.run(1)
    held.device.error = "is closed"
    held.run(3)
    assert held.state == "fault"
    assert held.core.safety.reason == "device: lost: unplugged"
    assert held.core.safety.counts["fault"] == 1


def test_a_failure_to_write_is_one_too(held: Held) -> None:
    held.handle.read(held.tick)
    held.device.error = "takes no bytes"
    held.handle.write((1.0,))
    assert held.core.safety.reason == "device: takes no bytes"


def test_a_failed_device_gets_the_force_that_fades_and_is_then_let_go(held: Held) -> None:
    """It may still be reached; and whoever calibrates it must be able to open it."""
    held.device.error = "encoder b is stuck"
    held.run(40)
    forces = [call for call in held.device.calls if isinstance(call, tuple)]
    fading = [force[0] for force in forces[: forces.index((0.0,)) + 1]]
    assert fading[-1] == 0.0
    assert fading == sorted(fading, reverse=True)
    assert 10 < len(fading) <= 22, "over 20 ms"
    assert "close" in held.device.calls
    assert held.device.calls.index("close") > held.device.calls.index((0.0,))


def test_the_force_that_acts_is_told_to_the_core(held: Held) -> None:
    held.run(1)
    assert held.core.acting == []
    held.device.given = (0.25,)
    held.run(1)
    assert held.core.acting == [(0.25,)]


def test_re_arming_without_a_fault_does_nothing(held: Held) -> None:
    assert held.handle.rearm() == ""
    held.run(2 * SETTLED)
    assert held.state == "live"
    held.core.handle(DeviceFailed("later"), held.core.now_ns)
    held.run(2 * SETTLED)
    assert held.state == "fault", "it was not asked of this fault"
    assert ("open", RATE_HZ) not in held.device.calls


def test_a_device_that_did_not_fail_is_not_opened_anew(held: Held) -> None:
    held.core.handle(DeviceFailed("over-speed"), held.core.now_ns)
    held.run(30)
    assert held.handle.rearm() == ""
    held.run(SETTLED)
    assert held.state == "fault"
    held.run(1)
    assert held.state == "live"
    assert "close" not in held.device.calls
    assert ("open", RATE_HZ) not in held.device.calls


def test_a_device_that_failed_is_opened_anew(held: Held) -> None:
    held.device.error, held.device.refused = "unplugged", "is not there; plug it in"
    held.run(50)
    for _ in range(2):
        assert held.handle.rearm() == "is not there; plug it in"
        held.run(2 * SETTLED)
        assert held.state == "fault"
    held.device.error = held.device.refused = ""
    assert held.handle.rearm() == ""
    held.tick += 300  # opening took its time: what comes first says nothing about the loop
    held.run(SETTLED + 1)
    assert held.state == "live"
    assert held.core.safety.limit((1.0,))[0] < 0.01, "force ramps in from nothing"
    held.device.calls.clear()
    held.run(2)
    assert "close" not in held.device.calls


@pytest.mark.parametrize(("gap", "state"), [(MOST_GAP_TICKS - 1, "live"), (MOST_GAP_TICKS, "fault")])
def test_samples_must_come_without_a_gap(held: Held, gap: int, state: str) -> None:
    held.core.handle(DeviceFailed("device stall"), held.core.now_ns)
    held.handle.rearm()
    held.run(SETTLED // 2)
    held.device.sample = None
    held.run(gap)
    held.device.sample = HERE
    held.run(SETTLED + 1 - SETTLED // 2 - gap)
    assert held.state == state
    held.run(SETTLED)
    assert held.state == "live"


def test_a_device_that_stays_silent_is_given_up(held: Held) -> None:
    held.core.handle(DeviceFailed("device stall"), held.core.now_ns)
    held.device.sample = None
    held.handle.rearm()
    held.run(ARMING + 1)
    assert held.handle.refusal == ""
    held.run(1)
    assert "no steady samples within 1 s" in held.handle.refusal
    held.device.sample = HERE
    held.run(2 * SETTLED)
    assert held.state == "fault", "it was given up"
    assert held.handle.rearm() == ""
    assert held.handle.refusal == ""
    held.run(SETTLED + 1)
    assert held.state == "live"


def test_a_device_that_fails_while_it_is_armed_says_why(held: Held) -> None:
    held.device.error = "encoder a jumped"
    held.run(50)
    held.device.error = ""
    assert held.handle.rearm() == ""
    held.run(3)
    held.device.error = "the tip is outside its workspace"
    held.run(1)
    assert held.handle.refusal == "the tip is outside its workspace"
    assert held.core.safety.reason == "device: encoder a jumped", "the fault is still the same"
    held.device.error = ""
    held.run(2 * SETTLED)
    assert held.state == "fault"


@pytest.mark.parametrize("given", [(-8.0,), (float("nan"),), (0.5, 0.5)])
def test_a_report_that_nobody_asked_for_is_not_believed_and_ends_it(held: Held, given: tuple[float, ...]) -> None:
    held.device.given = given
    held.run(2)
    assert held.core.acting == []
    assert held.state == "live"
    held.run(1)
    assert held.state == "fault"
    assert held.core.safety.reason.startswith("device: sim: says that (")
    assert held.handle.counts == {"implausible force reported": 3}


def test_a_clock_tells_calls_that_block(held: Held) -> None:
    """A third of all calls may be twice too long, not more; and a device that was opened anew has a clean sheet."""
    now_ns = 0
    tick_ns = 1_000_000_000 // RATE_HZ

    def clock() -> int:
        return now_ns

    def read(tick: int) -> Sample:
        nonlocal now_ns
        now_ns += 2 * tick_ns if tick % every == 0 else 0
        return HERE

    held.device.read = read  # type: ignore[method-assign]
    held.handle = SupervisedDevice(held.device, held.core, RATE_HZ, clock)  # type: ignore[arg-type]
    every = 3
    held.run(1000)
    assert held.state == "live"
    assert held.handle.counts["slow read"] == pytest.approx(333, abs=1)
    every = 2
    held.run(1000)
    assert held.state == "fault"
    assert held.core.safety.reason.startswith("device: sim: its read took 2.0 ms, and a tick has 1 ms")
    every = 3
    assert held.handle.rearm() == ""
    held.run(SETTLED + 1)
    assert held.state == "live"
