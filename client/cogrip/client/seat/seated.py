"""The part of a client that exists only with a seat: hand, coupling, safety, device port and energy ledger.

A tick has two halves. `sense` adds the hand's motion since the last tick to coupling and ledgers and, at the end of a frame,
sends the frame; `act` plays the wave that has come and returns the force to hold until the next tick (`HandForce`). In a tick
that was skipped the device held the last force: its waves are computed as well.
"""

from collections.abc import Callable, Sequence
from math import dist

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.schemes import make_coupling
from cogrip.client.effects.effect_force import EffectForce
from cogrip.client.hand.axes import AxisUnits
from cogrip.client.hand.grip_axes import GripAxes
from cogrip.client.hand.handle import HandleReader, has_handle
from cogrip.client.hand.pose_axes import PoseAxes
from cogrip.client.safety.device_port import Cause, DevicePort, cure
from cogrip.client.safety.limiter import DRIVES, Safety
from cogrip.client.safety.shaking import Shaking
from cogrip.client.seat.hand_force import HandForce
from cogrip.client.seat.hand_motion import HandMotion, work_and_velocity
from cogrip.client.seat.hand_orders import HandOrders
from cogrip.client.seat.leaving import Leaving
from cogrip.client.seat.peaks import Peaks
from cogrip.client.seat.rest_feel import RestFeel
from cogrip.client.seat.work_account import WorkAccount
from cogrip.client.sources.force_source import ForceSources
from cogrip.client.sources.hand_aids import HandAids
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.machine.rows import Row
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.messages import FRAMES, Edges, Effects, Frame, View, encode
from cogrip.protocol.wire.session import ClientSession

MakePort = Callable[[Capability, float, int], DevicePort]


def axis_units(seat: SeatSettings) -> AxisUnits:
    """Return what makes lengths of the axes of a seat."""
    axes, length_scale = seat.object.axes, seat.coupling.length_scale
    if axes == POSE_AXES:
        return PoseAxes(length_scale)
    return GripAxes(length_scale) if axes == GRIP_AXES else AxisUnits()


class SeatedClient:
    """One person's seat. capability: of the device, its first axes; `tick` is -1 before the first one.

    Inside, all of a hand that turns or has a gripper is in lengths (`units`): `force_n`, `hand` and what they are given to.
    `wrench`, `pose` and `twist` are as the device has them.
    """

    __slots__ = (
        "_acted", "_force", "_frame_begin", "_frame_end", "_frame_start_m", "_leaving", "_origin_m", "_origin_pose", "_rate_hz",
        "_record", "_ticks_per_frame", "_wave_end", "aids", "capability", "coupling", "effects", "force_n", "frame", "hand",
        "handle", "ledger", "orders", "peaks", "port", "rest", "safety", "session", "session_id", "settings", "shaking",
        "sources", "tick", "units",
    )  # fmt: skip

    def __init__(self, seat: SeatSettings, session: ClientSession, capability: Capability, make_port: MakePort) -> None:
        rates, axes = seat.rates, seat.object.axes
        self.settings, self.session = seat, session
        self.session_id = session.welcome.session if session.welcome else 0
        # From the device to the coupling and back
        self.units = axis_units(seat)
        self.handle: HandleReader | None = None  # where the device has one
        self._set_record(capability)
        self.safety = Safety(self.capability, rates.tick_s, seat.coupling.length_scale)
        self.hand = HandMotion(self._record, rates, self.safety, self._masses_kg())
        self.aids = HandAids(seat.workspace_limit, seat.gravity_compensation, self.capability, rates.tick_s)
        self.effects = EffectForce(axes, rates.tick_s, seat.damper_nspm)
        self.orders = HandOrders(seat, self.aids)
        self.frame = self.orders.frame
        self.coupling: Coupling = make_coupling(seat)
        self.port = make_port(self._record, rates.tick_s, rates.ticks_per_frame)
        self.sources = ForceSources(self.effects, self.aids)
        self.sources.fit(self._record, self.capability, self.port.tolerated_j)
        self.shaking = Shaking(axes, rates.tick_s)
        self._force = HandForce(self.coupling, self.sources, self.port, self.safety, self.shaking)
        # Accounts
        self.ledger = WorkAccount(self.coupling)
        if self.frame.mapped:
            self.ledger.set_power_ratio(self.frame.power_ratio)
        self.peaks = Peaks()
        self.rest = RestFeel(seat, self.capability.resolution_m)
        # The tick and the frame under way
        self.force_n: Row = (0.0,) * axes
        self.tick = self._acted = -1
        self._rate_hz = float(rates.device_hz)
        self._ticks_per_frame = rates.ticks_per_frame
        self._frame_begin = 0  # tick at which the frame under way began, and that at which it ends
        self._frame_end = rates.ticks_per_frame
        self._wave_end = 0  # tick at which the wave that is played now ends
        self._origin_m: Row | None = None
        self._origin_pose: Row = ()
        self._frame_start_m: tuple[float, ...] = ()
        self._leaving = Leaving(axes, self._rate_hz)
        self._fit()

    # Where hand and tool are

    @property
    def pose(self) -> Row:
        """Position of the hand [m], and rotation vector [rad] or opening [m]."""
        return self.units.pose(self.hand.position_m)

    @property
    def twist(self) -> Sequence[float]:
        """Velocity of the hand [m/s], and angular velocity [rad/s] or rate of opening [m/s]."""
        return self.units.rates(self.hand.velocity_mps)

    @property
    def wrench(self) -> Row:
        """Force [N] and torque [N m], or force of the gripper [N], of this tick, shape (axes,)."""
        return self.units.wrench(self.force_n)

    def tool_m(self) -> Row:
        """Return the tool's place, in lengths."""
        return self.frame.place(self.hand.position_m)

    def tool_pose(self) -> Row:
        """Return the tool's position [m], and rotation vector [rad] or opening [m]."""
        frame, units = self.frame, self.units
        if not frame.mapped:
            return self.pose
        return units.tool_pose(self.tool_m(), frame.rotation(self.pose[PLACES:]) if frame.turns else ())

    def place(self) -> Row:
        """Return the tool's pose, and of one that turns also the angle travelled since the line's beginning."""
        assert self._origin_m is not None
        moved = [at - begun for at, begun in zip(self.tool_m(), self._origin_m, strict=True)]
        return self.tool_pose() + self.units.travelled(moved)

    # Device, session and orders

    def _set_record(self, capability: Capability) -> None:
        self.capability = capability.first(self.settings.object.axes)
        self._record = self.units.record(self.capability)
        if self.handle is None and has_handle(capability):
            self.handle = HandleReader(self.session.dropped)
        if self.handle is not None:
            self.handle.fit(capability)

    def _masses_kg(self) -> Row:
        """Apparent mass of each axis, in lengths; none where the waves are made of the velocity, as in P: of places alone."""
        return () if self.settings.coupling.encoder == "velocity" else self.units.masses_kg(self.capability)

    def _fit(self) -> None:
        """Set resolution, lag and age of samples of the device record in coupling and ledger."""
        self.rest.set_resolution(self.capability.resolution_m)
        self.ledger.set_latency(self.capability.latency_ticks)
        self._fit_coupling()

    def _fit_coupling(self) -> None:
        self.coupling.set_latency(self.capability.latency_ticks)
        self.coupling.fit(self.frame.record(self._record, self.settings.rates.tick_s), self.port.lag_s)

    def equip(self, capability: Capability) -> None:
        """Set the record of the device that is open now."""
        if self.tick < 0 and self.safety.state == "idle" and self._leaving.began is None:
            self.safety.event("open")
        self._set_record(capability)
        self.safety.set_record(self.capability)
        self.port.set_record(self._record)
        self.hand.fit(self._record, self._masses_kg())
        self.sources.fit(self._record, self.capability, self.port.tolerated_j)
        self._fit()

    def renew(self, session_id: int) -> None:
        """Begin a new wave line for a resumed session. The ticks of the frame under way carry no motion."""
        self.session_id = session_id
        self.orders.changes.begin()
        self.coupling = self._force.coupling = coupling = make_coupling(self.settings)
        self.ledger.begin_line(coupling)
        self.sources.forget()
        self._fit_coupling()
        if self.handle is not None:
            self.handle.edges.begin()
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
        """Set the place of the hand at which the line begins."""
        self._origin_m = self.frame.place(position_m)
        self._origin_pose = self.tool_pose()

    @property
    def clutched(self) -> bool:
        """Return whether the clutch is to be held, whatever its button does."""
        return self.frame.asked

    def clutch(self, held: bool) -> None:
        """Hold the clutch, or release it: from the next tick on."""
        self.orders.clutch(held)
        self.frame = self.orders.frame

    def _follow(self, sample: Sample, border: bool) -> None:
        """Apply clutch and orders after a tick's sample. border: whether a frame ends here, or none has begun."""
        orders, ordered = self.orders, border and self.orders.waiting is not None
        if ordered:
            applied = orders.apply(self.hand.position_m, self.pose)
            self.frame, holds = orders.frame, orders.holds()
            if applied.tool:
                self.ledger.set_power_ratio(self.frame.power_ratio)
                self.settings = replace(self.settings, tool=self.frame.tool)
                self._fit_coupling()
                self.sources.begin_anew()  # their springs held energy by the ratio before
            if applied.aids:
                self.settings = replace(
                    self.settings, workspace_limit=self.aids.limit, gravity_compensation=holds.gravity_compensation
                )
            if applied.tool or applied.aids:
                self.safety.ramp_anew()
            if applied.line is not None:
                self._change_line(applied.line)
        if self.frame.mapped:
            orders.hold(sample.buttons, self.hand.position_m, self.pose)
            self.safety.event("clutch" if self.frame.held else "engage")
        if border:
            orders.report(ordered)

    def _change_line(self, change: HandChange) -> None:
        """Go by another line or spring; neither is felt as a step (theory 7.3, 3.7), so that no force ramps."""
        self.settings = settings = self.settings.changed(change)
        self.coupling.change(settings)
        self.effects.leave(self.coupling.seat_now().damper_nspm)
        self.orders.line = self.coupling.line_held().after(HandChange(**change.of_spring()).after(self.orders.line))

    def stop(self) -> None:
        """Release the hand and the object."""
        if self.safety.event("stop"):
            self._leaving.began = self.tick

    def rearm(self) -> None:
        """Leave a latched fault."""
        if self.safety.event("rearm"):
            self.port.rearm()

    def applied(self, force_n: tuple[float, ...]) -> None:
        """Set the force that the device applies in place of the one that `act` returned."""
        force_n = self.units.force(force_n)
        self.safety.applied(force_n)
        self.force_n = force_n

    def receive(self, message: Frame | View, now_ns: int) -> None:
        """Push a frame of the session to the coupling; one of another coupling is dropped and counted."""
        coupling = self.coupling
        before = coupling.newest
        if self.handle is not None and not isinstance(message, View):
            self.handle.edges.acknowledge(message.edges)
        if not isinstance(message, FRAMES[self.settings.coupling.traits.frame]) or not coupling.receive(message):
            self.session.drop("unfit")
        elif coupling.newest > before:
            self.session.mark_fresh(now_ns)

    def receive_effects(self, told: Effects) -> Effects:
        """Set an effect that the server sent. Return the acknowledgement, with the numbers of all effects that are known."""
        effects = self.effects
        if reason := effects.tell(told, self.tick):
            self.session.drop(reason)
        return replace(told, numbers=effects.known(told.numbers), effect=None)

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        """Process the ticks since the last call, with the sample read now; queue the frame that ended in them."""
        elapsed, session = tick - self.tick, self.session
        if self.tick < 0:
            elapsed = 0
            if self.safety.state == "idle":
                self.safety.event("open")  # ticks are of a device that is open
            # silence counts from the first tick: opening the device took its time
            session.last_received_ns = session.fresh_ns = now_ns
        self.tick = tick
        hand, handle = self.hand, self.handle
        if handle is not None and sample is not None:
            handle.read(sample, tick)
        if sample is not None and self.units.further:
            sample = self.units.lengths(sample)
        position = hand.update(tick, elapsed, sample, self.force_n)
        if position is not None and self.coupling.turns:
            self.coupling.turn(self.tool_m(), self.tool_pose()[PLACES:])
        ended = False
        if self._origin_m is None:
            self.ledger.elapse(elapsed, self.force_n)
            if position is None:
                session.heartbeat(now_ns)  # no hand yet, so no waves: the seat is kept all the same
            else:
                self._begin_at(position)
                if self.safety.state == "calibrating":
                    self.safety.event("calibrated")
                self._frame_start_m = position
                self._frame_begin = tick - tick % self._ticks_per_frame
                self._frame_end = self._frame_begin + self._ticks_per_frame
        elif (ended := self._account(elapsed, position)) and session.state == "seated":
            session.outbox.append(self.coupling.message(
                self.session_id, session.clock, now_ns, self._origin_pose, self.place(),
                self.frame.shown(hand.velocity_mps),
                None if handle is None else handle.message(tick),
            ))  # fmt: skip
        elif handle is not None and session.state == "seated" and (told := handle.message_at_once(tick)) is not None:
            session.outbox.append(encode(Edges(self.session_id, session.clock.stamp(now_ns), told)))
        if sample is not None and (self.frame.mapped or self.orders.waiting is not None):
            self._follow(sample, ended or self._origin_m is None)

    def _account(self, elapsed: int, position_m: tuple[float, ...] | None) -> bool:
        """Add `elapsed` ticks, to the hand's place `latency_ticks` ago, to coupling and ledgers. True if a frame ended."""
        coupling, ledger, hand = self.coupling, self.ledger, self.hand
        force = ledger.acting(elapsed, self.force_n) if hand.latency_ticks and elapsed else self.force_n
        frame, ratio, sources = self.frame, ledger.power_ratio, self.sources
        of_coupling = self._coupling_part(elapsed, force, position_m) if sources.present and elapsed else force
        coupling.applied_n = frame.tool_force(of_coupling)
        if position_m is None or not elapsed:
            mean: Sequence[float] = (0.0,) * len(force)
        else:
            work, mean = work_and_velocity(force, hand.start_m, position_m, self._rate_hz / elapsed)
            ledger.work.add(work)
        first = self.tick - elapsed + 1
        velocity = hand.start_mps
        if frame.mapped:
            mean, velocity = frame.shown(mean), frame.shown(velocity)
        ended, absent, held, hold = False, self.safety.state == "fault", frame.held, 1.0
        leaving = self._leaving
        if leaving.began is None:
            leaving.velocity_mps = mean
        else:
            hold, velocity = leaving.hold(self.tick), leaving.velocity_mps
            mean = velocity
        port = self.port
        for tick in range(first, self.tick + 1):
            if tick > self._wave_end:  # the wave ended within the ticks that were skipped
                self._start_frame(tick - 1)
            if absent:
                coupling.elapse_absent()
            elif held:
                coupling.elapse_held()
            else:
                coupling.elapse(mean, velocity, hold)
            if tick >= self._frame_end:
                ended = True
                port.set_energies(ledger.work.value + sources.potential_j, ledger.given_j, ratio * coupling.pending_j())
                length = coupling.end_frame(port.spare_j / ratio)
                port.set_energies(ledger.work.value + sources.potential_j, ledger.given_j)  # less what was sent
                if position_m is not None:
                    self._end_frame(position_m, tick - self._frame_begin)
                self._frame_begin, self._frame_end = tick, tick + length
        given_j, pending_j = ratio * coupling.given_j(), ratio * coupling.pending_j()
        port.set_energies(ledger.work.value + sources.potential_j, ledger.closed_given_j + given_j, pending_j)
        ledger.compare()
        return ended

    def _coupling_part(self, elapsed: int, force: Sequence[float], position_m: Row | None) -> Sequence[float]:
        """Return the coupling's part of the force in `elapsed` ticks, and add the work of the sources' part to the ledger."""
        sources = self.sources
        force = sources.enter(elapsed, self.force_n, force, self.hand.start_m, position_m)
        if sources.work_j != self.ledger.sources_j:
            self.ledger.set_sources(sources.work_j)
        return force

    def _start_frame(self, tick: int) -> None:
        """Play the next wave from this tick on."""
        ticks = self.coupling.start_frame()
        late = (tick - self._wave_end) % self._ticks_per_frame if ticks == self._ticks_per_frame else 0
        self._wave_end = tick + ticks - late

    def _end_frame(self, position_m: tuple[float, ...], ticks: int) -> None:
        start_m, self._frame_start_m = self._frame_start_m, position_m
        self.peaks.travel_m += dist(position_m[:PLACES], start_m[:PLACES])
        stored_j, sources = self.ledger.power_ratio * self.coupling.stored_j, self.sources
        if sources.present:
            stored_j += sources.stored_j(position_m)
        self.port.end_frame(start_m, position_m, ticks / self._rate_hz, stored_j)
        if self.safety.state != "live":  # the force is released
            return
        self.rest.enter(self.coupling, self.frame, position_m, sources.rest_of(self.force_n))

    def act(self, now_ns: int) -> tuple[float, ...]:
        """Return force [N], torque [N m] or the gripper's force [N], shape (axes,), to hold for a tick: F of P eq. 9."""
        coupling, safety, session = self.coupling, self.safety, self.session
        if self.tick >= self._wave_end:
            self._start_frame(self.tick)
            if coupling.implausible:
                safety.note(coupling.implausible)
            if coupling.played:  # datagrams come in bursts: a buffered frame played on schedule shows a live link, too
                session.mark_fresh(now_ns)
        self._acted = self.tick
        if safety.state == "armed":
            safety.event("go")
        if session.state == "resuming" or session.stale(now_ns):
            safety.event("stale", "nothing new from the server")
        elif safety.state == "degraded" and not self.port.releases.releasing:
            safety.event("fresh")
        force = self._force.force(self.tick, self.hand, self.frame)
        if self._force.cause:
            self._degrade(self._force.cause)
        self.peaks.enter(force, self.force_n, self.units)
        self.force_n = force
        return self.units.wrench(force) if self.units.further else force

    def _degrade(self, cause: Cause) -> None:
        """Ramp the force out (`degraded`); a fault where that has not helped MOST_RELEASES times."""
        safety, reason = self.safety, cure(cause, self.settings, self.capability)
        safety.note(f"released: {cause}")
        if cause == "limit":
            safety.saturated = safety.saturated or reason
        if self.port.releases.persists:
            if cause != "limit":
                safety.unstable = safety.unstable or reason
            safety.fail(f"{reason}, then re-arm; {DRIVES}")
        else:
            safety.event("stale", reason)

    @property
    def may_leave(self) -> bool:
        """True once no force is left on the hand, and the server knows: leaving is then no force step for the others."""
        if not self.safety.quiet or self._leaving.began is None or self.session.state != "seated":
            return self.safety.quiet
        loop_s = ((self.coupling.loop_frames() or 0.0) + self.late_frames) * self._ticks_per_frame / self._rate_hz
        return self._leaving.over(self.tick, loop_s)

    @property
    def late_frames(self) -> float:
        """Delay of the uplink by the age of samples [frames], which makes the line softer; exact with the boxcar decimator."""
        displacement = self.settings.coupling.encoder == "displacement"
        return self.hand.latency_ticks / self._ticks_per_frame if displacement else 0.0
