"""The part of a client that exists only with a seat: hand, coupling, safety, device port and energy ledger.

A tick has two halves. `sense` adds the hand's motion since the last tick to coupling and ledgers and, at the end of a frame,
sends the frame; `act` plays the wave that has come and returns the force to hold until the next tick. In a tick that was
skipped the device held the last force: its waves are computed as well.
"""

from collections import deque
from collections.abc import Callable, Sequence
from math import dist
from operator import mul, sub

from msgspec.structs import replace

from cogrip.client.coupling import Coupling
from cogrip.client.device_port import Cause, DevicePort, cure
from cogrip.client.effects.force import EffectForce
from cogrip.client.energy_ledger import EnergyLedger
from cogrip.client.felt_stiffness import REST_S, FeltStiffness
from cogrip.client.hand_aids import part_of
from cogrip.client.hand_motion import HandMotion, work_and_velocity
from cogrip.client.peaks import Peaks
from cogrip.client.pose_axes import PoseAxes, Row
from cogrip.client.safety import DRIVES, Safety
from cogrip.client.schemes import SCHEMES
from cogrip.client.seat_hand import SeatHand
from cogrip.client.shaking import Shaking
from cogrip.devices.device import Capability
from cogrip.devices.sample import Sample
from cogrip.machine.addition import add_floats
from cogrip.protocol.messages import Edges, Effects, Frame, View, encode
from cogrip.protocol.session import ClientSession
from cogrip.protocol.setting_types import PLACES
from cogrip.protocol.settings import SeatSettings

LEAVE_FADE_S = 0.5  # time from `stop` in which what the line still holds the object by fades
MOST_LOOP_S = 0.5
"""A client that leaves then stays for one measured loop, and this at most, so that the end of the fade arrives."""
MakePort = Callable[[Capability, float, int], DevicePort]


class SeatedClient(SeatHand):
    """One person's seat. capability: of the device, its first axes; `tick` is -1 before the first one."""

    __slots__ = (
        "_acted", "_frame_begin", "_frame_end", "_frame_start_m", "_origin_m", "_origin_pose", "_rate_hz", "_stop_mps",
        "_stopped", "_ticks_per_frame", "_wave_end", "_zero_n", "deficit_frames", "felt", "peaks", "port",
        "session_id", "shaking", "tick",
    )  # fmt: skip

    def __init__(self, seat: SeatSettings, session: ClientSession, capability: Capability, make_port: MakePort) -> None:
        rates = seat.rates
        super().__init__(seat, session, capability)
        self.session_id = session.welcome.session if session.welcome else 0
        self.coupling: Coupling = SCHEMES[seat.coupling.kind].make(seat)
        self.safety = Safety(self.capability, rates.tick_s, seat.coupling.length_scale)
        self.port = make_port(self._record, rates.tick_s, rates.ticks_per_frame)
        self.ledger = EnergyLedger(self.coupling)
        self.effects: EffectForce | None = None  # once one was told
        self.hand = HandMotion(self._record, rates, self.safety, self._masses_kg())
        self.peaks = Peaks()
        self.shaking = Shaking(seat.object.axes, rates.tick_s)
        self.tick = self._acted = -1
        self._zero_n = self.force_n
        self._ticks_per_frame = rates.ticks_per_frame
        self._frame_begin = 0  # tick at which the frame under way began, and that at which it ends
        self._frame_end = rates.ticks_per_frame
        self.deficit_frames: deque[float] = deque(maxlen=max(2, round(REST_S / rates.frame_s)))  # of the last live ones
        self._wave_end = 0  # tick at which the wave that is played now ends
        self._rate_hz = float(rates.device_hz)
        self._origin_m: Row | None = None
        self._origin_pose: Row = ()
        self._frame_start_m: tuple[float, ...] = ()
        self._stopped: int | None = None  # tick of `stop`
        self._stop_mps: Sequence[float] = self._zero_n  # velocity of the hand at `stop`
        self.felt = FeltStiffness(self.capability.resolution_m, rates.frame_s) if seat.holds_still else None
        if seat.tool is not None:
            self._set_tool(seat.tool)
        self._fit()

    def _fit(self) -> None:
        """Set resolution, lag and age of samples of the device record in coupling and ledger."""
        if self.felt is not None:
            self.felt.resolution_m = self.capability.resolution_m
        self.ledger.set_latency(self.capability.latency_ticks)
        self._fit_coupling()

    def _fit_coupling(self) -> None:
        self.coupling.set_latency(self.capability.latency_ticks)
        record, hand_map = self._record, self._hand_map
        if hand_map is not None:
            record = hand_map.record(record, self.settings.rates.tick_s)
        self.coupling.fit(record, self.port.lag_s)

    def equip(self, capability: Capability) -> None:
        """Set the record of the device that is open now."""
        if self.tick < 0 and self.safety.state == "idle" and self._stopped is None:
            self.safety.event("open")
        self._set_record(capability)
        self.safety.set_record(self.capability)
        self.port.set_record(self._record)
        self.hand.fit(self._record, self._masses_kg())
        self.aids.set_record(self.capability)
        if self.effects is not None:
            self.effects.fit(self._record, self.port.tolerated_j)
        self._fit()

    def renew(self, session_id: int) -> None:
        """Begin a new wave line for a resumed session. The ticks of the frame under way carry no motion."""
        self.session_id = session_id
        self.changes.begin()
        self.coupling = coupling = SCHEMES[self.settings.coupling.kind].make(self.settings)
        self.ledger.begin_line(coupling)
        if self.effects is not None:
            self.effects.forget()
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
        self._origin_m = position_m if self._hand_map is None else self._hand_map.place(position_m)
        self._origin_pose = self.tool_pose()

    def stop(self) -> None:
        """Release the hand and the object."""
        if self.safety.event("stop"):
            self._stopped = self.tick

    def rearm(self) -> None:
        """Leave a latched fault."""
        if self.safety.event("rearm"):
            self.port.rearm()

    def applied(self, force_n: tuple[float, ...]) -> None:
        """Set the force that the device applies in place of the one that `act` returned."""
        if self._axis_units is not None:
            force_n = self._axis_units.force(force_n)
        self.safety.applied(force_n)
        self.force_n = force_n

    def receive(self, message: Frame | View, now_ns: int) -> None:
        """Push a frame of the session to the coupling; one of another coupling is dropped and counted."""
        coupling = self.coupling
        before = coupling.newest
        if self.handle is not None and not isinstance(message, View):
            self.handle.edges.acknowledge(message.edges)
        if not isinstance(message, SCHEMES[self.settings.coupling.kind].message) or not coupling.receive(message):
            self.session.drop("unfit")
        elif coupling.newest > before:
            self.session.mark_fresh(now_ns)

    def receive_effects(self, told: Effects) -> Effects:
        """Set an effect that the server sent. Return the acknowledgement, with the numbers of all effects that are known."""
        if self.effects is None:
            b = getattr(self.settings.coupling, SCHEMES[self.settings.coupling.kind].damper[1])
            self.effects = EffectForce(len(self.force_n), self.settings.rates.tick_s, b)
            self.effects.fit(self._record, self.port.tolerated_j)
        if reason := self.effects.tell(told, self.tick):
            self.session.drop(reason)
        return replace(told, numbers=self.effects.known(told.numbers), effect=None)

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
        if self._axis_units is not None and sample is not None:
            sample = self._axis_units.lengths(sample)
        position = hand.update(tick, elapsed, sample, self.force_n)
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
                hand.velocity_mps if self._hand_map is None else self._hand_map.shown(hand.velocity_mps),
                None if handle is None else handle.message(tick),
            ))  # fmt: skip
        elif handle is not None and session.state == "seated" and (told := handle.message_at_once(tick)) is not None:
            session.outbox.append(encode(Edges(self.session_id, session.clock.stamp(now_ns), told)))
        if sample is not None and (self._hand_map is not None or self._ordered is not None):
            self._follow(sample, ended or self._origin_m is None)

    def place(self) -> Row:
        """Return the tool's pose, and of one that turns also the angle travelled since the line's beginning."""
        if not isinstance(self._axis_units, PoseAxes):
            return self.tool_pose()
        assert self._origin_m is not None
        moved = [at - begun for at, begun in zip(self.tool_m(), self._origin_m, strict=True)]
        return self.tool_pose() + self._axis_units.rates(moved)[PLACES:]

    def _account(self, elapsed: int, position_m: tuple[float, ...] | None) -> bool:
        """Add `elapsed` ticks, to the hand's place `latency_ticks` ago, to coupling and ledgers. True if a frame ended."""
        coupling, ledger, hand = self.coupling, self.ledger, self.hand
        force = ledger.acting(elapsed, self.force_n) if hand.latency_ticks and elapsed else self.force_n
        hand_map, ratio, aids = self._hand_map, ledger.power_ratio, self.aids
        coupling_n = force
        if aids.active or self.effects is not None:
            coupling_n = self._coupling_part(elapsed, force, position_m)
        coupling.applied_n = coupling_n if hand_map is None else hand_map.tool_force(coupling_n)
        if position_m is None or not elapsed:
            mean: Sequence[float] = (0.0,) * len(force)
        else:
            work, mean = work_and_velocity(force, hand.start_m, position_m, self._rate_hz / elapsed)
            ledger.work.add(work)
        first = self.tick - elapsed + 1
        ended, velocity = False, hand.start_mps
        absent, held, hold = self.safety.state == "fault", False, 1.0
        if hand_map is not None:
            held, mean, velocity = hand_map.held, hand_map.shown(mean), hand_map.shown(velocity)
        if self._stopped is None:
            self._stop_mps = mean
        else:  # the fading force lets the hand move off: the line gets the velocity at `stop`, scaled by `hold`
            hold = max(0.0, 1.0 - (self.tick - self._stopped) / (LEAVE_FADE_S * self._rate_hz))
            velocity = mean = self._stop_mps
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
                port.set_energies(ledger.work.value + aids.potential_j, ledger.given_j, ratio * coupling.pending_j())
                length = coupling.end_frame(port.spare_j / ratio)
                port.set_energies(ledger.work.value + aids.potential_j, ledger.given_j)  # less what was sent
                if position_m is not None:
                    self._end_frame(position_m, tick - self._frame_begin)
                self._frame_begin, self._frame_end = tick, tick + length
        given_j, pending_j = coupling.given_j(), coupling.pending_j()
        if hand_map is not None:
            given_j, pending_j = ratio * given_j, ratio * pending_j
        port.set_energies(ledger.work.value + aids.potential_j, ledger.closed_given_j + given_j, pending_j)
        ledger.compare()
        return ended

    def _coupling_part(self, elapsed: int, force: Sequence[float], position_m: Row | None) -> Sequence[float]:
        """Return the coupling's part of the force in `elapsed` ticks, and add the work of the effects' part to the ledger."""
        aids, effects = self.aids, self.effects
        held_n: Sequence[float] = self.force_n
        if aids.active:
            held_n = tuple(map(sub, held_n, aids.extra_n))
            force = tuple(map(sub, force, aids.acting(elapsed)))
        if effects is not None and elapsed:
            force = effects.enter(elapsed, held_n, force, self.hand.start_m, position_m)
            self.ledger.set_effects(effects.work_j)
        return force

    def _start_frame(self, tick: int) -> None:
        """Play the next wave from this tick on."""
        ticks = self.coupling.start_frame()
        late = (tick - self._wave_end) % self._ticks_per_frame if ticks == self._ticks_per_frame else 0
        self._wave_end = tick + ticks - late

    def _end_frame(self, position_m: tuple[float, ...], ticks: int) -> None:
        start_m, self._frame_start_m = self._frame_start_m, position_m
        self.peaks.travel_m += dist(position_m[:PLACES], start_m[:PLACES])
        stored_j, effects = self.ledger.power_ratio * self.coupling.stored_j, self.effects
        if self.aids.active:
            stored_j += self.aids.stored_j(position_m)
        if effects is not None:
            stored_j += effects.stored_j
        self.port.end_frame(start_m, position_m, ticks / self._rate_hz, stored_j)
        if self.safety.state != "live":  # the force is released
            return
        self.deficit_frames.append(max(0.0, self.coupling.deficit_frames))
        if self.felt is not None:
            side = self.settings.side_sign
            force_n = self.force_n if effects is None else effects.rest_of(self.force_n)
            if self._hand_map is not None:
                position_m, force_n = self._hand_map.place(position_m), self._hand_map.tool_force(force_n)
            depth, direction = self.coupling.pressed or (side * position_m[0], (side,))
            self.felt.add(depth, add_floats(map(mul, direction, force_n)))

    def act(self, now_ns: int) -> tuple[float, ...]:
        """Return force [N], torque [N m] or the gripper's force [N], shape (axes,), to hold for a tick: F of P eq. 9."""
        coupling, safety, session = self.coupling, self.safety, self.session
        if self.tick >= self._wave_end:
            self._start_frame(self.tick)
            if coupling.implausible:
                safety.note("wave beyond what the device can bring about")
            if coupling.played:  # datagrams come in bursts: a buffered frame played on schedule shows a live link, too
                session.mark_fresh(now_ns)
        self._acted = self.tick
        if safety.state == "armed":
            safety.event("go")
        if session.state == "resuming" or session.stale(now_ns):
            safety.event("stale", "nothing new from the server")
        elif safety.state == "degraded" and not self.port.releasing:
            safety.event("fresh")
        force = self._render()
        self.peaks.enter(force, self.force_n, self._axis_units)
        if safety.state == "live" and safety.gain == 1.0:
            self.shaking.enter(force if self.effects is None else self.effects.rest_of(force))
        else:
            self.shaking.pause()
        self.force_n = force
        return force if self._axis_units is None else self._axis_units.wrench(force)

    def _render(self) -> tuple[float, ...]:
        """Return the force of this tick [N], shape (axes,), limited by energy (`port`), then by the device (`safety`).

        rendered_n  of coupling, effects and injected damping; None for none
        aids_n      of workspace limit and gravity compensation; wanted_n: of both
        clamped_n   the same, clamped to the device's peak; cut_n: what that removed of the coupling's part
        """
        coupling, safety, port, hand = self.coupling, self.safety, self.port, self.hand
        port.elapse()
        hand_map = self._hand_map
        if hand_map is None:
            coupling.carried_nspm = port.carried_nspm
            wanted_n = coupling.force(hand.position_m, hand.velocity_mps) if safety.state != "fault" else None
        else:
            coupling.carried_nspm = port.carried_nspm / hand_map.stiffest
            tool_m, tool_mps = hand_map.place(hand.position_m), hand_map.rates(hand.velocity_mps)
            wanted_n = hand_map.hand_force(coupling.force(tool_m, tool_mps)) if safety.state != "fault" else None
        if (effects := self.effects) is not None:
            wanted_n = effects.added(self.tick, wanted_n, hand.position_m, hand.velocity_mps, safety, port, hand_map)
        if port.balance_j < 0.0 and wanted_n is not None and (injected := port.injected_nspm):
            wanted_n = [law + injected * speed for law, speed in zip(wanted_n, hand.velocity_mps, strict=True)]
        rendered_n, aids, aids_n = wanted_n, self.aids, self._zero_n
        if aids.active and rendered_n is not None:
            aids_n = aids.force(hand.position_m, hand.velocity_mps)
            wanted_n = [law + extra for law, extra in zip(rendered_n, aids_n, strict=True)]
        force = safety.limit(port.limit(wanted_n) if wanted_n is not None else None, coupling.gap())
        coupling.ramp_gain = safety.gain
        port.ramped = safety.gain != 1.0
        coupling.cut_n = None
        if aids.active:
            aids.share(aids_n, wanted_n or self._zero_n, force)
        if wanted_n is not None and rendered_n is not None and safety.state == "live":
            local_n = coupling.local_n if hand_map is None else hand_map.hand_force(coupling.local_n)
            watched_n: Sequence[float] = force
            reduced = coupling.reduced
            if effects is not None and effects.asked_n is not None:
                local_n, watched_n = effects.watched(local_n, force, safety.gain)
                reduced = reduced or effects.reduced
            if port.ramped:
                local_n = [safety.gain * local for local in local_n]
            elif (clamped_n := safety.clamped_n) is not wanted_n:
                # the line must not be given energy for force that limits removed
                cut_n = [law - left for law, left in zip(wanted_n, clamped_n, strict=True)]
                if aids.active or (effects is not None and effects.asked_n is not None):
                    effects_n = effects.asked_n if effects is not None and effects.asked_n is not None else self._zero_n
                    fraction = 1.0 - part_of(clamped_n, wanted_n)
                    cut_n = [fraction * (law - other) for law, other in zip(rendered_n, effects_n, strict=True)]
                coupling.cut_n = cut_n if hand_map is None else hand_map.tool_force(cut_n)
            if cause := port.watch(watched_n, safety.at_peak(), local_n, safety.limited, reduced, coupling.absorbs):
                self._degrade(cause)
        return force

    def _degrade(self, cause: Cause) -> None:
        """Ramp the force out (`degraded`); a fault where that has not helped MOST_RELEASES times."""
        safety, reason = self.safety, cure(cause, self.settings, self.capability)
        safety.note(f"released: {cause}")
        if cause == "limit":
            safety.saturated = safety.saturated or reason
        if self.port.persists:
            if cause != "limit":
                safety.unstable = safety.unstable or reason
            safety.fail(f"{reason}, then re-arm; {DRIVES}")
        else:
            safety.event("stale", reason)

    @property
    def may_leave(self) -> bool:
        """True once no force is left on the hand, and the server knows: leaving is then no force step for the others."""
        if not self.safety.quiet or self._stopped is None or self.session.state != "seated":
            return self.safety.quiet
        loop_s = ((self.coupling.loop_frames() or 0.0) + self.late_frames) * self._ticks_per_frame / self._rate_hz
        return self.tick - self._stopped >= (LEAVE_FADE_S + min(loop_s, MOST_LOOP_S)) * self._rate_hz

    @property
    def late_frames(self) -> float:
        """Delay of the uplink by the age of samples [frames], which makes the line softer; exact with the boxcar decimator."""
        displacement = self.settings.coupling.encoder == "displacement"
        return self.hand.latency_ticks / self._ticks_per_frame if displacement else 0.0
