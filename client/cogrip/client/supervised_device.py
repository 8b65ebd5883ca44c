"""A device under supervision: a failure becomes a latched fault, and re-arming opens the device anew.

A driver may have defects: whatever it raises or returns, however long it takes, the force ends and the loop goes on.

fault --rearm: opened anew where it had failed--> arming --samples for SETTLED_S--> live
arming --fails, or not settled within ARMING_S--> fault, and `refusal` says why
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Literal

from cogrip.client.core import ClientCore
from cogrip.client.inputs import DeviceFailed, DeviceOpened, ForceApplied, Rearm
from cogrip.client.safety.limiter import STALL_S
from cogrip.client.safety.rendered_damper import OverloadError, refusal
from cogrip.devices.device import Capability, Device, DeviceError, defect, defects_named
from cogrip.devices.plausibility import ForceReports
from cogrip.devices.sample import Sample

SETTLED_S = 0.03  # time of samples without a gap after which the velocity estimate has forgotten what was before
ARMING_S = 1.0
STARVED_EVERY = 32
"""Ticks from one look at how long the loop waited for a processor to the next: a look takes a microsecond."""
MOST_GAP_TICKS = 3  # most ticks between two samples that are no gap: a reply may be missed now and then

Verb = Literal["read", "write"]


class SupervisedDevice:
    """One device of one core. Only `open` raises, and only DeviceError.

    clock    time [ns], by which a call that blocks is found; None in virtual time, where none does
    starved  time [ns] for which this thread has been ready without a processor; None where that is not known. A call that
             is long for that does not block: the device is not to blame, and whoever watches the ticks sees a late one
    spared   never drive the device with settings that ask for more than it carries
    refusal  why re-arming failed once it had begun
    """

    def __init__(
        self,
        device: Device,
        core: ClientCore,
        rate_hz: int,
        clock: Callable[[], int] | None = None,
        starved: Callable[[], int] | None = None,
        *,
        spared: bool = False,
    ) -> None:
        self.device = device
        self._spared = spared
        self.refusal = ""
        self.counts: Counter[str] = Counter()
        self._core = core
        self._rate_hz = rate_hz
        self._tick_ns = 1e9 / rate_hz
        self._clock = clock
        self._starved, self._starved_ns = starved, 0  # as it was last asked for
        self._set_record(core.capability)
        self._blocked_ns = 0.0  # by which calls were longer than a tick, less a quarter tick for each that was not
        self._slow: Verb | Literal[""] = ""  # the call that blocked, and is not made any more
        self._failed = False
        self._arming = False
        self._first = self._last = self._begun = -1  # ticks of samples without a gap, and of re-arming

    def open(self) -> None:
        """Open the device. One may know its limits only then; safety goes by those. Raises DeviceError."""
        with defects_named(self._name, "open"):
            before = self.device.capability
            self._judge(before)
            self.device.open(self._rate_hz)
            opened = self.device.capability
        self._core.handle(DeviceOpened(opened), self._core.now_ns)
        if opened != before:
            try:
                self._judge(opened)
            except OverloadError:
                self.device.close()
                raise
        self._set_record(self._core.capability)
        self._blocked_ns, self._slow = 0.0, ""

    def _set_record(self, record: Capability) -> None:
        """Set the record by which samples and forces are judged."""
        self._record, self._axes, self._gives_velocity = record, record.axes, record.gives_velocity
        self._reports = ForceReports(record, self._rate_hz)

    def _judge(self, record: Capability) -> None:
        """Raise OverloadError where the seat asks for more than a spared device carries."""
        if self._spared and (seat := self._core.seat) is not None and (text := refusal(seat, record)):
            raise OverloadError(text)

    def read(self, tick: int) -> Sample | None:
        """Return the sample at `tick`, None where there is none."""
        if self._slow and self._slow == "read":  # a comparison of texts takes longer
            return None
        clock = self._clock
        if self._starved is not None and tick % STARVED_EVERY == 0:
            self._starved_ns = self._starved()
        begun_ns = clock() if clock else 0
        try:
            sample = self.device.read(tick)
            if sample is not None:
                sample = self._checked(sample)
        except Exception as error:  # noqa: BLE001 (a defect of the driver, whatever it is)
            self._fail("read", error)
            return None
        if clock and self._blocks("read", clock() - begun_ns):
            return None
        if self._arming:
            self._watch(sample is not None, tick)
        return sample

    def write(self, force_n: Sequence[float]) -> None:
        """Write a force, also in a fault: a device that can still be reached takes the force that fades out."""
        if self._slow and self._slow == "write":
            force_n = (0.0,) * len(force_n)  # there is no time to let it fade
        clock = self._clock
        begun_ns = clock() if clock else 0
        try:
            self._reports.asked(force_n)
            applied = self.device.write(force_n)
            if applied is not None:
                self._applied(tuple([float(part) for part in applied]))
        except Exception as error:  # noqa: BLE001 (a defect of the driver, whatever it is)
            self._fail("write", error)
        if clock:
            self._blocks("write", clock() - begun_ns)
        if self._failed and self._core.safety.quiet:
            self.close()  # so that it can be repaired
        if self._arming and self._last - self._first >= SETTLED_S * self._rate_hz:
            self._arming = False
            self._core.handle(Rearm(), self._core.now_ns)

    def close(self) -> None:
        """Close the device. What it raises is counted: nothing more can be done about it."""
        try:
            self.device.close()
        except Exception as error:  # noqa: BLE001 (a defect of the driver, whatever it is)
            self.counts[f"{type(error).__name__} as the device was closed"] += 1

    def rearm(self) -> str:
        """Begin to leave a latched fault; open a device that failed anew. Returns why that cannot be, "" if it can.

        Force may flow once samples have come for SETTLED_S. Nothing is done where there is no fault, or this has begun.
        """
        if self._arming or self._core.safety.state != "fault":
            return ""
        if self._failed:
            self.close()
            try:
                self.open()
            except DeviceError as error:
                return str(error)
            self._failed = False
        self.refusal = ""
        self._arming = True
        self._first = self._last = self._begun = -1
        return ""

    @property
    def _name(self) -> str:
        """Name of its driver."""
        return self._core.capability.family

    def _checked(self, sample: Sample) -> Sample:
        """Return a sample of plain floats. Raises DeviceError for one that no core can take, or whatever its parts raise."""
        if not isinstance(sample, Sample):
            raise DeviceError(f"{self._name}: gives {sample!r:.200}, which is no Sample; correct its driver")
        position, velocity, axes = sample.position_m, sample.velocity_mps, self._axes
        if not (_plain(position) and (velocity is None or _plain(velocity))):  # no recording holds others
            position = tuple([float(part * 1.0) for part in position])  # text is no number
            velocity = None if velocity is None else tuple([float(part * 1.0) for part in velocity])
            sample = sample.replaced(position_m=position, velocity_mps=velocity)
        fits = not self._gives_velocity if velocity is None else len(velocity) == axes
        if not fits or len(position) != axes or type(sample.age_ticks) is not int:
            record = self._record
            says = f"{record.axes} axes{' and a velocity' if record.gives_velocity else ''}"
            raise DeviceError(f"{self._name}: gives {sample}, and its record says {says}; correct its driver")
        return sample

    def _applied(self, force_n: tuple[float, ...]) -> None:
        """Report the force that the device applies in place of the one it was asked for."""
        wrong = self._reports.judge(force_n)
        if not wrong:
            self._core.handle(ForceApplied(force_n), self._core.now_ns)
            return
        self.counts[wrong] += 1
        if self._reports.fault:
            self._fail("write", DeviceError(f"{self._name}: {self._reports.fault}"))

    def _blocks(self, verb: Verb, took_ns: int) -> bool:
        """Return True where calls have blocked for STALL_S, and the hand held an old force.

        That call is made no more, so that the loop releases the hand on time.
        """
        tick_ns = self._tick_ns
        if took_ns <= tick_ns:
            if self._blocked_ns:
                self._blocked_ns = max(0.0, self._blocked_ns - 0.25 * tick_ns)  # two calls a tick
            return False
        if self._was_starved(took_ns):
            self.counts[f"processor late in {verb}"] += 1
            return False
        self.counts[f"slow {verb}"] += 1
        self._blocked_ns += took_ns - tick_ns
        if self._blocked_ns < STALL_S * 1e9:
            return False
        if not self._slow:
            self._slow = verb
            text = f"{self._name}: its {verb} took {took_ns * 1e-6:.1f} ms, and a tick has {tick_ns * 1e-6:.2g} ms:"
            other = ", or to what took the processor from it" if self._starved is None else ""
            cure = f"see to its driver{other}, then re-arm"
            self._fail(verb, DeviceError(f"{text} the loop must not wait for a device; {cure}"))
        return True

    def _was_starved(self, took_ns: int) -> bool:
        """Return whether there was no processor for most of a call, so that it took so long."""
        if self._starved is None:
            return False
        before_ns, self._starved_ns = self._starved_ns, self._starved()
        return 2 * (self._starved_ns - before_ns) > took_ns

    def _watch(self, sampled: bool, tick: int) -> None:
        """Follow whether samples come again."""
        if self._begun < 0:
            self._begun = tick
        if sampled:
            if self._first < 0 or tick - self._last > MOST_GAP_TICKS:
                self._first = tick
            self._last = tick
        if tick - self._begun > ARMING_S * self._rate_hz:
            self._arming = False
            span = f"{ARMING_S:g} s"
            self.refusal = f"the device gave no steady samples within {span}; check its cable and power, then re-arm"

    def _fail(self, verb: Verb, error: Exception) -> None:
        """Latch a fault; an error other than DeviceError is a defect of the driver."""
        if not isinstance(error, DeviceError):
            error = defect(self._name, verb, error)
        self._failed = True
        if self._arming:
            self._arming = False
            self.refusal = str(error)
        if self._core.safety.state != "fault":
            self._core.handle(DeviceFailed(f"device: {error}"), self._core.now_ns)


def _plain(row: Sequence[float]) -> bool:
    """Return whether this is a tuple of floats: not a list, and no whole numbers or numpy's."""
    if type(row) is not tuple:
        return False
    for part in row:  # noqa: SIM110 - compiled, a plain loop
        if type(part) is not float:
            return False
    return True
