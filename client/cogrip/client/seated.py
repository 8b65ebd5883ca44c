"""The part of a client that exists only with a seat: hand, coupling, safety, device port and energy ledger.

A tick has two halves. `sense` enters what the hand did since the last tick and, at a frame border, sends the frame; `act`
plays the wave that has come and gives the force to hold until the next tick. A tick that was skipped had its force held: its
waves are entered all the same.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import dist, hypot
from operator import mul

from cogrip.client.coupling import AnyCoupling
from cogrip.client.device_port import Cause, DevicePort, cure
from cogrip.client.energy_ledger import EnergyLedger
from cogrip.client.hand_motion import HandMotion
from cogrip.client.pose_axes import PoseAxes, Row, in_lengths
from cogrip.client.safety import Safety
from cogrip.client.schemes import SCHEMES
from cogrip.devices.device import Capability, Sample
from cogrip.protocol.accounts import ClientAccount, DelayAccount, Percentiles, TickCount
from cogrip.protocol.messages import Frame, View, clipped, encode
from cogrip.protocol.session import ClientSession
from cogrip.protocol.setting_types import PLACES, POSE_AXES
from cogrip.protocol.settings import SeatSettings

RELEASE_S = 0.5  # from `stop`, in which the line releases the object
MOST_LOOP_S = 0.5  # for which the end waits until the server knows
REST_S = 0.5  # for which frames must agree before a hand is at rest
LEAST_N = 0.05  # with which it presses then: less is the rounding of a hand that touches nothing
MakePort = Callable[[Capability, float], DevicePort]


@dataclass(slots=True)
class Peaks:
    """Largest force and change of force between two ticks [N], torque [N m], and the path from frame to frame [m]."""

    force_n: float = 0.0
    torque_nm: float = 0.0
    step_n: float = 0.0
    travel_m: float = 0.0


class FeltStiffness:
    """Stiffness felt at rest: force over displacement, fed once a frame. resolution_m: of the device."""

    def __init__(self, resolution_m: float, frame_s: float) -> None:
        self.resolution_m = resolution_m
        self._samples: deque[tuple[float, float]] = deque(maxlen=max(2, round(REST_S / frame_s)))

    def add(self, depth_m: float, force_n: float) -> None:
        """Take the depth pressed and the force along it."""
        self._samples.append((depth_m, force_n))

    def stiffness_npm(self) -> float | None:
        """Return the mean force over the mean depth; None while the hand moves, or where nothing pushes back."""
        count = len(self._samples)
        if count != self._samples.maxlen:
            return None
        depths = [depth for depth, _ in self._samples]
        depth, force = sum(depths) / count, sum([force for _, force in self._samples]) / count
        if depth <= 0.0 or force < LEAST_N or max(depths) - min(depths) > max(2.0 * self.resolution_m, 1e-3 * depth):
            return None
        return force / depth


class SeatedClient:
    """One person's seat. capability: of the device, its first axes; `tick` is -1 before the first one.

    Inside, all of a hand that turns is in lengths (`pose_axes`): `force_n`, `hand` and what they are given to. `wrench`, `pose`
    and `twist` are as the device has them.
    """

    def __init__(self, seat: SeatSettings, session: ClientSession, capability: Capability, make_port: MakePort) -> None:
        rates = seat.rates
        self.settings = seat
        self.session = session
        self.session_id = session.welcome.session if session.welcome else 0
        self._axes = PoseAxes(seat.coupling.length_m) if seat.object.axes == POSE_AXES else None
        self._set_record(capability)
        self._scheme = SCHEMES[seat.coupling.kind]
        self.coupling: AnyCoupling = self._scheme.make(seat)
        self.safety = Safety(self.capability, rates.tick_s, seat.coupling.length_m)
        self.port = make_port(self._record, rates.tick_s)
        self.ledger = EnergyLedger(self.coupling)
        self.hand = HandMotion(self._record, rates, self.safety)
        self.peaks = Peaks()
        self.tick = self._acted = -1
        self.force_n: Row = (0.0,) * seat.object.axes
        self._ticks_per_frame = rates.ticks_per_frame
        self._frame_begin = 0  # tick at which the frame under way began, and that at which it ends
        self._frame_end = rates.ticks_per_frame
        self._owed: deque[float] = deque(maxlen=max(2, round(REST_S / rates.frame_s)))  # frames, of the last live ones
        self._wave_end = 0  # tick at which what is played now is to be followed by the next wave
        self._rate_hz = float(rates.device_hz)
        self._origin_m: Row | None = None
        self._origin_pose: Row = ()
        self._frame_start_m: tuple[float, ...] = ()
        self._stopped: int | None = None  # tick of `stop`
        self._parting_mps: Sequence[float] = self.force_n  # velocity of the hand at `stop`
        self._felt = FeltStiffness(self.capability.resolution_m, rates.frame_s) if seat.holds_still else None
        self._fit()
        for event in ("open", "calibrated", "go"):
            self.safety.event(event)

    def _set_record(self, capability: Capability) -> None:
        self.capability = self._record = capability.first(self.settings.object.axes)
        if self._axes is not None:
            self._record = in_lengths(self.capability, self._axes.length_m)

    @property
    def pose(self) -> Row:
        """Position of the hand [m], and rotation vector [rad]."""
        position = self.hand.position_m
        return position if self._axes is None else self._axes.pose(position)

    @property
    def twist(self) -> Sequence[float]:
        """Velocity of the hand [m/s], and angular velocity [rad/s]."""
        velocity = self.hand.velocity_mps
        return velocity if self._axes is None else self._axes.rates(velocity)

    @property
    def wrench(self) -> Row:
        """Force [N] and torque [N m] of this tick, shape (axes,)."""
        return self.force_n if self._axes is None else self._axes.wrench(self.force_n)

    def _fit(self) -> None:
        """Go by the record's resolution and lag, and by the age of its samples."""
        if self._felt is not None:
            self._felt.resolution_m = self.capability.resolution_m
        self.ledger.set_latency(self.capability.latency_ticks)
        self._fit_coupling()

    def _fit_coupling(self) -> None:
        self.coupling.set_latency(self.capability.latency_ticks)
        self.coupling.fit(self._record, self.port.lag_s)

    def equip(self, capability: Capability) -> None:
        """Go by the record of a device that is open now."""
        self._set_record(capability)
        self.safety.keep_to(self.capability)
        self.port.keep_to(self._record)
        self.hand.fit(self._record)
        self._fit()

    def renew(self, session_id: int) -> None:
        """Begin a new line, whose first frame began where the last one ended: with nothing, up to where the hand is now."""
        self.session_id = session_id
        self.coupling = coupling = self._scheme.make(self.settings)
        self.ledger.begin_line(coupling)
        self._fit_coupling()
        if self._origin_m is not None:
            self._begin_at(self.hand.position_m)
        if self.tick < 0:
            return
        if self._acted == self.tick or self.tick < self._wave_end:  # else `act` begins to play
            self._start_frame(self.tick)
        self._frame_end = self._frame_begin + self._ticks_per_frame
        for _ in range(self.tick - self._frame_begin):
            coupling.elapse_absent()

    def _begin_at(self, position_m: Row) -> None:
        """Let the line begin with the hand here."""
        self._origin_m = position_m
        self._origin_pose = position_m if self._axes is None else self._axes.pose(position_m)

    def stop(self) -> None:
        """Release the hand and the object."""
        if self.safety.event("stop"):
            self._stopped = self.tick

    def rearm(self) -> None:
        """Leave a latched fault."""
        if self.safety.event("rearm"):
            self.port.rearm()
            self.safety.event("go")

    def applied(self, force_n: tuple[float, ...]) -> None:
        """Enter the force that the device applies in place of the one that `act` returned: the hand feels this one."""
        if self._axes is not None:
            force_n = self._axes.force(force_n)
        self.safety.applied(force_n)
        self.force_n = force_n

    def receive(self, message: Frame | View, now_ns: int) -> None:
        """Take in a frame of the session."""
        coupling = self.coupling
        before = coupling.newest
        if not isinstance(message, self._scheme.message) or not coupling.receive(message):
            self.session.drop("unfit")
        elif coupling.newest > before:
            self.session.mark_fresh(now_ns)

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        """Enter the ticks since the last call, with the sample read now."""
        elapsed = tick - self.tick
        if self.tick < 0:
            elapsed = 0
            # silence counts from the first tick: opening the device took its time
            self.session.last_received_ns = self.session.fresh_ns = now_ns
        self.tick = tick
        hand = self.hand
        if self._axes is not None and sample is not None:
            sample = self._axes.lengths(sample)
        position = hand.update(tick, elapsed, sample)
        if self._origin_m is None:
            self.ledger.elapse(elapsed, self.force_n)
            if position is None:
                self.session.heartbeat(now_ns)  # no hand yet, so no waves: the seat is kept all the same
            else:
                self._begin_at(position)
                self._frame_start_m = position
                self._frame_begin = tick - tick % self._ticks_per_frame
                self._frame_end = self._frame_begin + self._ticks_per_frame
        elif self._enter(elapsed, position) and self.session.state == "seated":
            message = self.coupling.message(
                self.session_id, self.session.clock.stamp(now_ns), self._origin_pose, self._place(), hand.velocity_mps
            )
            self.session.outbox.append(encode(message))

    def _place(self) -> Row:
        """Return the hand's pose, and of one that turns also the angle travelled since the line's beginning."""
        if self._axes is None:
            return self.hand.position_m
        assert self._origin_m is not None
        moved = [at - begun for at, begun in zip(self.hand.position_m, self._origin_m, strict=True)]
        return self.pose + self._axes.rates(moved)[PLACES:]

    def _enter(self, elapsed: int, position_m: tuple[float, ...] | None) -> bool:
        """Enter `elapsed` ticks; the hand was at `position_m` `latency_ticks` ago. True if there is a frame to send."""
        coupling, ledger, hand = self.coupling, self.ledger, self.hand
        force = ledger.acting(elapsed, self.force_n) if hand.latency_ticks and elapsed else self.force_n
        coupling.applied_n = force
        if position_m is None or not elapsed:
            mean: Sequence[float] = (0.0,) * len(force)
        else:
            rate = self._rate_hz / elapsed
            work = 0.0
            mean = []
            before = hand.start_m
            for axis, place in enumerate(position_m):
                step = place - before[axis]
                work += force[axis] * step
                mean.append(step * rate)
            ledger.work.add(work)
        first = self.tick - elapsed + 1
        ended, velocity = False, hand.start_mps
        faulty, hold = self.safety.state == "fault", 1.0
        if self._stopped is None:
            self._parting_mps = mean
        else:  # a hand whose force fades runs off: the line is sent one that goes on as it did, and releases the object
            hold = max(0.0, 1.0 - (self.tick - self._stopped) / (RELEASE_S * self._rate_hz))
            velocity = mean = self._parting_mps
        port = self.port
        for tick in range(first, self.tick + 1):
            if tick > self._wave_end:  # it ended within the ticks that were skipped
                self._start_frame(tick - 1)
            if faulty:
                coupling.elapse_absent()
            else:
                coupling.elapse(mean, velocity, hold)
            if tick >= self._frame_end:
                ended = True
                port.enter(ledger.work.value, ledger.closed_given_j + coupling.given_border_j)
                length = coupling.end_frame(port.spare_j)
                port.enter(ledger.work.value, ledger.closed_given_j + coupling.given_border_j)  # what was sent is spent
                if position_m is not None:
                    self._end_frame(position_m, tick - self._frame_begin)
                self._frame_begin, self._frame_end = tick, tick + length
        port.enter(ledger.work.value, ledger.closed_given_j + coupling.given_j)
        ledger.compare()
        return ended

    def _start_frame(self, tick: int) -> None:
        """Play the next wave from this tick on."""
        ticks = self.coupling.start_frame()
        late = (tick - self._wave_end) % self._ticks_per_frame if ticks == self._ticks_per_frame else 0
        self._wave_end = tick + ticks - late

    def _end_frame(self, position_m: tuple[float, ...], ticks: int) -> None:
        start_m, self._frame_start_m = self._frame_start_m, position_m
        self.peaks.travel_m += dist(position_m[:PLACES], start_m[:PLACES])
        self.port.end_frame(start_m, position_m, ticks / self._rate_hz, self.coupling.stored_j)
        if self.safety.state != "live":  # the force is released
            return
        self._owed.append(max(0.0, self.coupling.owed_frames))
        if self._felt is not None:
            side = self.settings.side_sign
            depth, direction = self.coupling.pressed or (side * position_m[0], (side,))
            self._felt.add(depth, sum(map(mul, direction, self.force_n)))

    def act(self, now_ns: int) -> tuple[float, ...]:
        """Return force [N] and torque [N m], shape (axes,), to hold until the next tick: F of P eq. 9, which loads the hand."""
        coupling, safety, session = self.coupling, self.safety, self.session
        if self.tick >= self._wave_end:
            self._start_frame(self.tick)
            if coupling.implausible:
                safety.note("wave beyond what the device can bring about")
            if coupling.played:  # records come in clumps: a frame that is played in its time is as good as a new one
                session.mark_fresh(now_ns)
        self._acted = self.tick
        if session.state == "resuming" or session.stale(now_ns):
            safety.event("stale", "nothing new from the server")
        elif safety.state == "degraded" and not self.port.releasing:
            safety.event("fresh")
        force, before, peaks = self._render(), self.force_n, self.peaks
        self.force_n = force
        if self._axes is not None:
            peaks.torque_nm = max(peaks.torque_nm, self._axes.length_m * hypot(*force[PLACES:]))
            step, size = dist(force[:PLACES], before[:PLACES]), hypot(*force[:PLACES])
        elif len(force) == 1:
            step, size = abs(force[0] - before[0]), abs(force[0])
        else:
            step, size = dist(force, before), hypot(*force)
        if step > peaks.step_n:
            peaks.step_n = step
        if size > peaks.force_n:
            peaks.force_n = size
        return force if self._axes is None else self._axes.wrench(force)

    def _render(self) -> tuple[float, ...]:
        """Return the law's force, as far as the device port and safety let it."""
        coupling, safety, port, hand = self.coupling, self.safety, self.port, self.hand
        port.elapse()
        coupling.carried_nspm = port.carried_nspm
        wish = coupling.force(hand.position_m, hand.velocity_mps) if safety.state != "fault" else None
        if wish is not None and (paying := port.paying_nspm):
            wish = [law + paying * speed for law, speed in zip(wish, hand.velocity_mps, strict=True)]
        force = safety.limit(port.limit(wish) if wish is not None else None, coupling.gap)
        coupling.ramp_gain = safety.gain
        port.ramped = not safety.full
        coupling.cut_n = None
        if wish is not None and safety.state == "live":
            local_n = coupling.local_n
            if port.ramped:
                local_n = [safety.gain * local for local in local_n]
            elif (kept := safety.law_n) is not wish:  # the line does not see what limits took
                coupling.cut_n = [law - left for law, left in zip(wish, kept, strict=True)]
            if found := port.watch(force, safety.at_peak, local_n, safety.limited, coupling.reduced):
                self._release(found)
        return force

    def _release(self, found: Cause) -> None:
        """Degrade, or fault where that has not helped."""
        safety, reason = self.safety, cure(found, self.settings, self.capability)
        safety.note(f"released: {found}")
        if self.port.persists:
            safety.diverged = safety.diverged or reason
            safety.fail(f"{reason}, then re-arm")
        else:
            safety.event("stale", reason)

    @property
    def released(self) -> bool:
        """True once no force is left on the hand and the server knows that the line has released the object.

        To leave is then no jolt to those who stay.
        """
        if not self.safety.quiet or self._stopped is None or self.session.state != "seated":
            return self.safety.quiet
        loop_s = ((self.coupling.loop_frames() or 0.0) + self._late_frames) * self._ticks_per_frame / self._rate_hz
        return self.tick - self._stopped >= (RELEASE_S + min(loop_s, MOST_LOOP_S)) * self._rate_hz

    @property
    def _late_frames(self) -> float:
        """Time that a tick waits to be entered where samples are old: the line is softer by it, exactly so with the boxcar."""
        displacement = self.settings.coupling.encoder == "displacement"
        return self.hand.latency_ticks / self._ticks_per_frame if displacement else 0.0

    def account(self, ticks: TickCount, rtt_ms: Percentiles, delay: DelayAccount) -> ClientAccount:
        """Return all that this end knows. ticks: of its loop, as its driver counted them."""
        coupling, ledger, safety = self.coupling, self.ledger, self.safety
        loop = coupling.loop_frames()
        more = self._late_frames + sum(self._owed) / max(1, len(self._owed))
        predicted_npm = None if loop is None else coupling.seat_now().predicted_stiffness(loop, more)
        return ClientAccount(
            position_m=self.pose,
            force_n=self.wrench,
            peak_force_n=self.peaks.force_n,
            travel_m=self.peaks.travel_m,
            felt_stiffness_npm=self._felt.stiffness_npm() if self._felt else None,
            predicted_stiffness_npm=predicted_npm,
            down_margin_j=coupling.down_margin_j,
            device_leak_j=ledger.least_leak_j,
            down=ledger.count(),
            rtt_ms=rtt_ms,
            ticks=ticks,
            diverged=bool(safety.diverged),
            state=safety.state,
            reason=clipped(self.session.failed or safety.diverged or safety.reason),
            peak_step_n=self.peaks.step_n,
            playout=ledger.playout_account(),
            delay=delay,
            device=self.port.account(),
            down_reserve_j=ledger.down_reserve_j,
            peak_torque_nm=self.peaks.torque_nm,
            line=coupling.line_account(),
        )
