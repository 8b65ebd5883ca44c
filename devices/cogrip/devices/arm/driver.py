"""The device that an arm on a wire is: readings to positions, forces to currents, and everything that keeps force off.

closed --open: met, model as stated, pose known, tip inside--> open --close: zero sent--> closed
open --lost, jumped, stuck, out of the workspace--> every verb raises until it is closed and opened again
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import hypot, isfinite

from cogrip.devices.arm.encoder_watch import EncoderWatch
from cogrip.devices.arm.exchange import RETRY_S, Reading, RequestExchange, meet
from cogrip.devices.arm.model import ArmModel, Pose
from cogrip.devices.arm.pose import Calibration, KnownPose, OwnLosses, Store, drive_of
from cogrip.devices.device import Capability, DeviceError, Sample
from cogrip.devices.driver import Driver
from cogrip.devices.way_in import into_sphere
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Vector
from cogrip.protocol.laws.rotations import Quaternion

HEADROOM = 0.92
"""Largest force, as a fraction of the peak force. Currents are those of where the arm was, and hold as it moves on."""
SILENT_S = 0.05  # time after the last reading by which there is no current: nobody knows where the arm is then
ZERO: Vector = (0.0, 0.0, 0.0)
PAUSE_S = 0.09
"""Time without a request after which a firmware's watchdog may have switched the motors off: serial has 0.1 s."""
REST_S = 0.02  # time without force after a pause of PAUSE_S: the client takes the arm for let go, and ramps
TREMBLE_COUNTS = 20  # largest motion of an arm that a hand holds while its counters are loaded
GOODBYES = 2  # requests for no current that are made when the arm is closed
RISE_S = 0.3  # time in which the compensation of the weight rises from none to all
FALL_S = 0.04
"""Time in which the compensation of the weight falls to none: within the 50 ms after which no force may be left."""


class WeightCompensation:
    """Compensation of an arm's own weight. fraction: of it that the motors hold, 0 to 1; active: whether it is to be held.

    The torque for it is the gradient of the arm's potential energy (`Kinematics.gravity`), so that the hand feels none of it.
    It rises when the device is opened, as no force may step, and falls when the device has failed: the hand takes over.
    """

    def __init__(self, rate_hz: int, *, active: bool) -> None:
        self.fraction = 0.0
        self._rise = 1.0 / (RISE_S * rate_hz) if active else 0.0
        self._fall = 1.0 / (FALL_S * rate_hz)
        self._tick = 0

    def step(self, tick: int, *, failed: bool) -> float:
        """The fraction at `tick`, which does not fall. Ticks that were skipped do not make it rise in one step."""
        ticks, self._tick = tick - self._tick, tick
        change = -self._fall * ticks if failed else self._rise * min(1, ticks)
        self.fraction = min(1.0, max(0.0, self.fraction + change))
        return self.fraction


class ArmDevice(Driver):
    """See `Device`. axes: how many of x, y, z the room uses; the others are free.

    identify: asks the wire what it is, where the address leaves that open; gives the model.
    store: has the damping and friction that were identified; they go into the record.
    has_watchdog: the firmware lets the motors go where no command comes; without, nobody pushes an arm that no hand holds.
    """

    has_watchdog = True

    def __init__(
        self, name: str, axes: int, exchange: RequestExchange, known: Callable[[str], ArmModel], pose: Pose,
        model: ArmModel | None, store: Store,
    ) -> None:  # fmt: skip
        super().__init__(name, axes)
        self.exchange = exchange  # its wire, also for whoever makes the arm ready while it is closed
        self._known = known
        self._pose_kind: Pose = pose
        self._store = store
        self._model: ArmModel | None = None
        self._pose: KnownPose | None = None
        if model is not None:
            self._take(model)
        self._own: tuple[float, float] | None = None  # damping [N s/m] and friction [N], once looked for
        self._broken = self._said = self._stamp = ""
        self._silent_ticks = 0
        self._pause_ticks = self._rest_ticks = 0
        self._flows_at = 0  # tick from which force may flow
        self._written = -1  # tick of the newest write, -1 before the first
        self._read_at = 0  # when the newest reading was taken
        self._received_at = 0  # and when it came
        self.angles: Vector | None = None  # of the joints, at the last reading [rad]
        self._acting: Sequence[float] = ()
        self._offset: Vector = ZERO
        self._gimbal_offset: Vector = ZERO
        self._weight = WeightCompensation(1, active=False)
        self.reading: Reading | None = None

    @property
    def capability(self) -> Capability:
        record = self.model.record.first(self._axes)
        self._own = self._own or self._identified()
        damping_nspm, friction_n = self._own
        return replace(record, own_damping_nspm=damping_nspm, own_friction_n=friction_n)

    def _identified(self) -> tuple[float, float]:
        """Bounds of this arm's own damping [N s/m] and friction [N]; 0 where they are not known. Raises DeviceError."""
        losses = self._store.find_losses(self._where)
        if losses is None:
            return 0.0, 0.0
        if not losses.holds_for(self.model):
            self._counts["own damping left out: identified with other settings"] += 1
            return 0.0, 0.0
        return losses.own_damping_nspm, losses.own_friction_n

    def losses(self, damping_nspm: float, friction_n: float, made: str) -> OwnLosses:
        """Return what is to be kept of an identification of this arm."""
        return OwnLosses(
            device=self._where, model=self.model.record.model, drive=drive_of(self.model), own_damping_nspm=damping_nspm,
            own_friction_n=friction_n, made=made,
        )  # fmt: skip

    def home_words(self) -> str:
        """Return the home pose in words."""
        return "turret straight ahead, upper arm vertical, forearm horizontal"

    @property
    def model(self) -> ArmModel:
        """Return the device's model, asking the device where the address does not say. Raises DeviceError."""
        if self._model is None:
            line = self.exchange.line
            line.open()
            try:
                self._recognise(meet(self.exchange, ZERO))
            finally:
                line.close()
        assert self._model is not None
        return self._model

    @property
    def counts(self) -> Mapping[str, int]:
        return {**self.exchange.line.counts, **self.exchange.counts, **self._counts}

    @property
    def reads_only(self) -> bool:
        """True if the address says that the device is never to give force."""
        return self._pose is not None and self._pose.kind == "none"

    @property
    def weight_fraction(self) -> float:
        """Fraction of the arm's own weight that its motors were last commanded to hold."""
        return self._weight.fraction if self._open else 0.0

    def open(self, rate_hz: int) -> None:
        line = self.exchange.line
        if not self._open:
            self._own = None  # it may have been identified anew
        self._check_open(rate_hz, self.capability)
        line.open()
        try:
            reading = meet(self.exchange, ZERO)
            self._recognise(reading)
            assert self._pose is not None
            self._stamp = line.stamp()
            self._offset = self._pose.offset_counts(self._stamp)
            home = self.model.gimbal_home_counts
            loaded = self._pose_kind == "stored" and self.exchange.codec.load((*ZERO, *home)) is not None
            self._gimbal_offset = ZERO if loaded else home  # a device whose counters were loaded counts from there
            self._place(reading)
        except DeviceError:
            line.close()
            raise
        self.exchange.start(rate_hz)
        self._watch = EncoderWatch(3, self.model.record.resolution_m, rate_hz, self._tip)
        # a request may have to wait for RETRY_S, and it is to say zero
        self._silent_ticks = max(1, int((SILENT_S - RETRY_S) * rate_hz) - 1)
        self._weight = WeightCompensation(rate_hz, active=self.model.holds_weight and self._pose.kind != "none")
        self._pause_ticks, self._rest_ticks = int(PAUSE_S * rate_hz), round(REST_S * rate_hz)
        self._tick = self._read_at = self._received_at = self._flows_at = 0
        self._written = -1
        self._acting = self._zero
        self._broken = ""
        self._open = True

    def recognised(self, reading: Reading) -> ArmModel:
        """The model of a device that has answered so. Raises DeviceError where it is another one than it should be."""
        self._recognise(reading)
        return self.model

    def _recognise(self, reading: Reading) -> None:
        """Raises DeviceError where the device is another one than it should be."""
        found = self._known(reading.model)
        if self._model is not None and found.record.model != self._model.record.model:
            raise self._error(
                f"is {found.record.model} now, and was {self._model.record.model}; another device was plugged in"
            )
        self._said = reading.model
        if self._model is None:
            self._take(found)

    def _take(self, model: ArmModel) -> None:
        self._model = model
        self._pose = KnownPose(self._pose_kind, self._where, model.record.model, model.home_counts, self._store)

    def calibrate(self, made: str) -> Calibration:
        """The arm stands in its home pose now, and whoever calls this confirms it. Not while it is open. Raises DeviceError."""
        if self._open:
            raise self._error("is open; close it before it is calibrated")
        line, codec = self.exchange.line, self.exchange.codec
        line.open()
        try:
            reading = meet(self.exchange, ZERO)
            self._recognise(reading)
            home = self.model.home_counts
            load = codec.load((*home, *self.model.gimbal_home_counts))
            if load is not None:
                self._forget(line.stamp())
                line.write(load)
                codec.feed(line.read(0.1))
                reading = meet(self.exchange, ZERO)
                if any(abs(count - there) > TREMBLE_COUNTS for count, there in zip(reading.raw, home, strict=True)):
                    raise self._error(f"its counters read {reading.raw} after {home} were loaded; try again")
                reading = Reading(home)
            a, b, c = (there - count for there, count in zip(home, reading.raw, strict=True))
            return Calibration(
                device=self._where, model=self.model.record.model, offset_counts=(a, b, c), home_counts=home,
                stamp=line.stamp(), made=made,
            )  # fmt: skip
        finally:
            line.close()

    def _forget(self, stamp: str) -> None:
        """Whatever was known of the counters does not hold for those that are loaded now, should the rest go wrong."""
        assert self._pose is not None
        with suppress(DeviceError):  # there was nothing to forget
            self._pose.offset_counts(stamp)
            self._pose.lose("other counters were loaded")
            self._pose.settle()

    def _joints(self, raw: Sequence[float]) -> Vector:
        """Joint angles [rad] of raw counts."""
        a, b, c = raw
        da, db, dc = self._offset
        return self.model.drive.angles((a + da, b + db, c + dc))

    def _tip(self, raw: Sequence[float]) -> Sequence[float] | None:
        """Position [m] of raw counts."""
        return self.model.kinematics.forward(self._joints(raw))

    def _place(self, reading: Reading) -> Sequence[float]:
        """Position of a reading. Raises DeviceError where no tip can be."""
        model = self.model
        angles = self._joints(reading.raw)
        position = model.kinematics.forward(angles)
        if position is None or not isfinite(add_floats(position)):
            raise self._lost(f"the linkage does not close at counts {reading.raw}, so they are wrong")
        if not model.inside(position) and self._pose is not None and self._pose.kind != "none":
            where = ", ".join(f"{value:z.3f}" for value in position)
            way = into_sphere(position, model.reach_m) or "inside"
            raise self._error(
                f"the tip is at ({where}) m, outside its workspace of {model.reach_m:g} m; move it {way}, and arm again"
            )
        self.angles, self.reading = angles, reading
        return position

    def _lost(self, why: str) -> DeviceError:
        if self._pose is not None:
            self._pose.lose(why)
        return self._error(f"{why}; calibrate, then re-arm")

    def read(self, tick: int) -> Sample | None:
        self._check_read(tick)
        try:
            answer = self.exchange.reply(tick)
            if self._broken:
                raise DeviceError(self._broken)
            return None if answer is None else self._sample(*answer)
        except DeviceError as error:
            self._break(error)
            raise

    def _sample(self, reading: Reading, age: int) -> Sample | None:
        if reading.error:
            self._counts[f"device: {reading.error}"] += 1
            if reading.rejected:
                return None
        if reading.model != self._said:
            self._recognise(reading)
        taken = self._tick - age
        wrong = self._watch.check(reading.raw, taken - self._read_at)
        if wrong:
            raise self._lost(wrong)
        position = self._place(reading)
        self._read_at, self._received_at = taken, self._tick
        return Sample(tuple(position[: self._axes]), None, age, reading.buttons, self._turned(reading))

    def _turned(self, reading: Reading) -> Quaternion | None:
        """Return the handle's orientation, None where it is not known."""
        gimbal, angles, home = self.model.gimbal, self.angles, self._gimbal_offset
        if gimbal is None or angles is None or not reading.gimbal:
            return None
        counts = [count + offset for count, offset in zip(reading.gimbal, home, strict=True)]
        return gimbal.orientation(self.model.kinematics, angles, counts)

    def write(self, force_n: Sequence[float]) -> Sequence[float] | None:
        """A device that has failed takes a force that fades out, as long as it can be reached."""
        self._need_open("write")
        if len(force_n) != self._axes:
            raise self._wrong_force(force_n)
        finite = isfinite(add_floats(force_n))
        if 0 <= self._written <= self._tick - self._pause_ticks:
            self._counts["paused beyond the watchdog"] += 1
            self._flows_at, self._weight.fraction = self._tick + self._rest_ticks, 0.0
        self._written = self._tick
        currents, fraction = self._currents(force_n) if finite else (ZERO, 0.0)
        try:
            reported = self.exchange.ask(currents, self._tick)
        except DeviceError as error:
            self._break(error)
            raise
        if not finite:
            raise self._wrong_force(force_n, "; no current is sent instead")
        if reported:
            self._acting = tuple(force_n) if fraction == 1.0 else tuple([fraction * part for part in force_n])
        return None if reported and fraction == 1.0 else self._acting

    def _currents(self, force_n: Sequence[float]) -> tuple[Sequence[float], float]:
        """Currents, and the share of the force that they give. What holds the arm's weight is no part of that share.

        None at all where there may be no force: the pose is not known, or the arm has not answered lately.
        """
        assert self._pose is not None
        silent = self._tick - self._received_at > self._silent_ticks or self._tick < self._flows_at
        weight = self._weight.step(self._tick, failed=silent or bool(self._broken))
        if self._pose.kind == "none" or self.angles is None or silent or not (weight or any(force_n)):
            return ZERO, 0.0 if any(force_n) else 1.0
        x, y, z = (*force_n, 0.0, 0.0)[:3]
        size, most = hypot(x, y, z), HEADROOM * self.model.record.peak_force_n
        fraction = -1.0 if size <= most else -most / size  # the arm pushes the hand with -F
        push = (fraction * x, fraction * y, fraction * z)
        try:
            held, too_heavy = self.model.weight_currents(self.angles, weight) if weight else (ZERO, False)
            currents, limited = self.model.currents(self.angles, push, held)
        except DeviceError as error:
            self._broken = self._broken or str(error)
            return ZERO, 0.0
        if limited:
            fraction *= self.model.fraction_given(self.angles, push, currents, held)
        if too_heavy:
            self._counts["weight of the arm held in part only"] += 1
        if fraction != -1.0:
            self._counts["force limited to the motors"] += 1
        return currents, -fraction

    def close(self) -> None:
        """Zero current is asked for more than once: a request may be lost, or one may still be under way."""
        exchange, was_open = self.exchange, self._open
        self._open = False
        if was_open:
            for _ in range(GOODBYES):
                try:
                    exchange.line.read(0.02)
                    exchange.line.write(exchange.codec.encode(ZERO))
                except DeviceError:
                    self._counts["not reached when closed"] += 1
                    break
        exchange.line.close()
        if was_open and self._pose is not None:
            try:
                self._pose.settle()
            except DeviceError:
                self._counts["loss of the pose not kept"] += 1

    def _break(self, error: DeviceError) -> None:
        self._broken = str(error)
        if not self._stamp and self._pose is not None:  # nobody would notice that it was plugged in again
            self._pose.lose("it may have been without power")
