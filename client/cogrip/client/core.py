"""One person's client without I/O: samples and datagrams in, forces and datagrams out.

A tick has two halves. `sense(tick, sample, now_ns)` books what the hand did since the last tick and, at a frame border,
leaves the frame in `outbox`; `act(now_ns)` applies the wave that has come and gives the force to hold until the next
tick. Live they follow each other at once; in virtual time the laboratory puts the server's step between them, which is
the order of theory section 6. A tick that was skipped had its force held: its waves are booked all the same.

A server that was started anew gives another session: a new line begins with frame 0 where the hand is, and the books go on
over all lines.
"""

from collections import deque
from collections.abc import Callable, Sequence
from math import dist, hypot

from cogrip.client.account import account_of
from cogrip.client.coupling import COUPLINGS, Coupling
from cogrip.client.device_port import DevicePort, Trouble, cure
from cogrip.client.felt_stiffness import FeltStiffness
from cogrip.client.passivity_control import PassivityControl
from cogrip.client.past_lines import PastLines
from cogrip.client.safety import Safety
from cogrip.client.velocity import estimator_for
from cogrip.devices.device import Capability, Sample
from cogrip.devices.plausibility import JUMP, Plausibility
from cogrip.protocol.accounts import ClientAccount, LinkCount, PlayoutAccount, TickCount
from cogrip.protocol.histogram import DurationHistogram
from cogrip.protocol.line.energy_sums import add_compensated
from cogrip.protocol.messages import Hello, Stamp, View, encode
from cogrip.protocol.session import ClientSession
from cogrip.protocol.settings import SeatSettings

LET_GO_S = 0.5  # from `stop`, in which the line lets go of the object
MOST_LOOP_S = 0.5  # for which it is waited that the server has heard of it
RECKON_S = 12.0 / 1024.0  # without a sample, for which the hand is taken to go on as it did


class ClientCore:
    """Session, coupling, safety and books of one person."""

    make_port: Callable[[Capability, float], DevicePort] = DevicePort

    def __init__(self, hello: Hello, capability: Capability) -> None:
        self.session = ClientSession(hello)
        self.capability = capability
        self.seat: SeatSettings | None = None
        self.rtt = DurationHistogram()
        self.up = DurationHistogram()  # one way, as far as the clocks' offset is known
        self.down = DurationHistogram()
        self.rtt_ms = float("nan")  # the newest
        self.up_ms: float | None = None
        self.down_ms: float | None = None
        self.work_j = 0.0  # the hand's work against the force, exact: sum of F (x_{k+1} - x_k) (theory section 3.6)
        self._work_error_j = 0.0  # of that over the true sum
        self.leak_j = 0.0  # its part that did not go into the line, b (y_est - y) y T_c and what safety took
        self.least_leak_j = 0.0
        self.peak_force_n = self.peak_step_n = 0.0
        self.travel_m = 0.0
        self.tick = -1
        self.position_m: tuple[float, ...] = ()
        self.velocity_mps: Sequence[float] = ()
        self.force_n: tuple[float, ...] = ()
        self._left_workspace = ""

    @property
    def outbox(self) -> deque[bytes]:
        """Datagrams to send, oldest first."""
        return self.session.outbox

    @property
    def seated(self) -> bool:
        return self.seat is not None

    def call(self, now_ns: int) -> None:
        """Ask the server for a seat."""
        self.session.connect(now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        message = self.session.receive(datagram, now_ns)
        welcome = self.session.welcome
        if self.seat is None:
            if welcome is not None and welcome.role == "player":
                self._take_seat(welcome.settings, welcome.session)
            return
        if welcome is not None and welcome.session != self._session_id:
            self._renew(welcome.session)
        if message is None or isinstance(message, View):
            return
        if self.tick < 0:  # the device is still being opened: what comes now must not set the playout
            self.session.drop("before the first tick")
            return
        self._time(message.stamp, now_ns)
        coupling = self.coupling
        before = coupling.newest
        if not coupling.receive(message):
            self.session.drop("unfit")
        elif coupling.newest > before:
            self.session.mark_fresh(now_ns)

    def _time(self, stamp: Stamp, now_ns: int) -> None:
        """What a stamp tells of the ways and the clocks."""
        clock = self.session.clock
        rtt_ns = clock.read(stamp, now_ns)
        if rtt_ns is None:
            if stamp.echo_ns:
                self.session.drop("wild stamp")
            return
        self.rtt.add(rtt_ns)
        self.rtt_ms = rtt_ns * 1e-6
        assert clock.return_ns is not None
        self.down.add(clock.return_ns)
        self.down_ms = clock.return_ns * 1e-6
        if clock.fresh:
            assert clock.forward_ns is not None
            self.up.add(clock.forward_ns)
            self.up_ms = clock.forward_ns * 1e-6

    def _take_seat(self, seat: SeatSettings, session: int) -> None:
        axes, rates = seat.object.axes, seat.rates
        self.seat = seat
        self.capability = self.capability.first(axes)
        self.coupling: Coupling = COUPLINGS[seat.coupling.kind](seat)
        self._past = PastLines()
        self._acted = -1  # the tick of the last `act`
        self._stopped: int | None = None  # the tick of `stop`
        self._parting: Sequence[float] = (0.0,) * axes  # how the hand moved when it was told to stop
        self.safety = Safety(self.capability, rates.tick_s)
        self.port = self.make_port(self.capability, rates.tick_s)
        self._given_j = 0.0  # by all lines before the present one
        self._session_id = session
        self._ticks_per_frame = rates.ticks_per_frame
        self._rate = float(rates.device_hz)
        self._reckon_ticks = round(RECKON_S * rates.device_hz)
        self._rest = FeltStiffness(self.capability.resolution_m, rates.frame_s) if seat.object.kind == "wall" else None
        self._origin: tuple[float, ...] | None = None
        self._jumped: tuple[float, ...] | None = None  # what jumps have added to the device's positions
        self._sampled = 0  # the tick at which the newest position was taken
        self._forces: deque[tuple[float, ...]] = deque()  # of the last ticks, oldest first, where samples are old
        self._frame_position: tuple[float, ...] = ()
        self.force_n = self.velocity_mps = self.position_m = (0.0,) * axes
        self._fit()
        self.safety.event("open")
        self.safety.event("calibrated")
        self.safety.event("go")

    def _fit(self) -> None:
        """Fit to the record's estimator, and to the age of its samples."""
        assert self.seat is not None
        self._estimator = estimator_for(self.capability, self.seat.rates.tick_s)
        self._plausibility = Plausibility(self.capability, self.seat.rates.tick_s)
        self._latency = ticks = self.capability.latency_ticks
        self._forces = deque([*[(0.0,) * len(self.force_n)] * ticks, *self._forces], maxlen=ticks)
        self.coupling.set_latency(ticks)
        self.coupling.fit(self.capability, self.port.lag_s)

    def _renew(self, session: int) -> None:
        """A new line, whose first frame began at the last border: with nothing, up to the place where the hand is now."""
        assert self.seat is not None
        self._past.close(self.coupling)
        self._given_j += self.coupling.given_j
        self._session_id = session
        self.coupling = coupling = COUPLINGS[self.seat.coupling.kind](self.seat)
        coupling.down_margin_j = self._past.least_j  # of all lines: the new one begins with 0
        coupling.set_latency(self._latency)
        coupling.fit(self.capability, self.port.lag_s)
        if self._origin is not None:
            self._origin = self.position_m
        ticks = self.tick % self._ticks_per_frame
        if self.tick < 0 or (ticks == 0 and self._acted != self.tick):
            return  # `act` begins the frame
        coupling.start_frame()
        for _ in range(ticks):
            coupling.elapse_absent()

    def equip(self, capability: Capability) -> None:
        """The device says of itself what it can do, now that it is open."""
        self.capability = capability.first(len(self.force_n))
        self.safety.keep_to(self.capability)
        self.port.keep_to(self.capability)
        self._fit()

    def stop(self) -> None:
        """Let go, of the hand and of the object; `released` tells when that is done."""
        if self.seat is not None and self.safety.event("stop"):
            self._stopped = self.tick

    @property
    def released(self) -> bool:
        """No force is left on the hand, and the server knows that the line has let go: leaving is no jolt to those who stay."""
        if not self.safety.quiet or self._stopped is None or self.session.state != "seated":
            return self.safety.quiet
        loop_s = ((self.coupling.loop_frames() or 0.0) + self._late_frames) * self._ticks_per_frame / self._rate
        return self.tick - self._stopped >= (LET_GO_S + min(loop_s, MOST_LOOP_S)) * self._rate

    def rearm(self) -> None:
        """Leave a latched fault. The caller has seen to its cause."""
        if self.safety.event("rearm"):
            self.port.rearm()
            self.safety.event("go")

    def fail(self, reason: str) -> None:
        """The device failed: latch a fault."""
        if self.seat is not None:
            self.safety.fail(reason)

    def poll(self, now_ns: int) -> None:
        """Session timers, where no ticks are run; call at least every 100 ms."""
        self.session.poll(now_ns)

    def keep_seat(self, now_ns: int) -> None:
        """Let the server hear of us before the first tick."""
        self.session.heartbeat(now_ns)

    def leave(self, reason: str, account: ClientAccount, now_ns: int) -> None:
        """Say goodbye with what this end knows; or answer the goodbye of a server that stopped first."""
        if self.session.state in ("seated", "resuming"):
            self.session.leave(reason, account, now_ns)
        elif self.session.farewell is not None:
            self.session.answer_farewell(account)

    def sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        """Book the ticks since the last call with the sample read now; session timers run as well."""
        self._sense(tick, sample, now_ns)
        self.session.poll(now_ns)

    def _sense(self, tick: int, sample: Sample | None, now_ns: int) -> None:
        elapsed = tick - self.tick if self.tick >= 0 else 0
        if self.tick < 0:
            # silence counts from the first tick: opening the device took its time
            self.session.last_received_ns = self.session.fresh_ns = now_ns
        self.tick = tick
        position: tuple[float, ...] | None = None
        velocity: Sequence[float] = ()
        if sample is not None and (wrong := self._plausibility.judge(tick, sample)):
            sample = self._refused(wrong, sample)
        if sample is None:
            self.safety.absent(elapsed)
        else:
            position, velocity = self._judged(elapsed, sample)
        if self._origin is None:
            self._forces.extend((self.force_n,) * elapsed)
            if position is None:
                self.session.heartbeat(now_ns)  # no hand yet, so no waves: the seat is kept all the same
                return
            self._origin = self._frame_position = self.position_m = position
            self.velocity_mps = velocity
            assert sample is not None
            self._sampled = tick - sample.age_ticks
            return
        reckoned = position
        if sample is None or position is None or sample.age_ticks != self._latency:
            reckoned = self._where(elapsed, sample, position, velocity)
        border = self._book(elapsed, reckoned)
        if reckoned is not None:
            self.position_m = reckoned
        if position is not None:
            self.velocity_mps = velocity
            assert sample is not None
            self._sampled = tick - sample.age_ticks
        if border:
            self._send(now_ns)

    def _judged(self, elapsed: int, sample: Sample) -> tuple[tuple[float, ...] | None, Sequence[float]]:
        """Position, None where safety has no use for it, and velocity."""
        position = sample.position_m
        if self._jumped is not None:
            position = tuple([at - jump for at, jump in zip(position, self._jumped, strict=True)])
        if sample.velocity_mps is not None:
            velocity: Sequence[float] = sample.velocity_mps
        else:
            assert self._estimator is not None
            velocity = self._estimator.update(position, max(1, self.tick - sample.age_ticks - self._sampled))
        if self.safety.check(elapsed, sample.position_m, velocity):
            return position, velocity
        if self._estimator is not None:
            self._estimator.reset()
        return None, velocity

    def _refused(self, wrong: str, sample: Sample) -> Sample | None:
        """A sample that no held device gives is not used. In a fault a jump sets a new reference: no hand has moved so."""
        judge, safety = self._plausibility, self.safety
        safety.note(wrong)
        if judge.fault:
            safety.fail(judge.fault)
        if wrong != JUMP or safety.state != "fault":
            return None
        self._jumped = tuple([at - here for at, here in zip(sample.position_m, self.position_m, strict=True)])
        judge.restart()
        judge.judge(self.tick, sample)
        return sample

    def _where(
        self, elapsed: int, sample: Sample | None, position: tuple[float, ...] | None, velocity: Sequence[float]
    ) -> tuple[float, ...] | None:
        """Where the hand was `latency` ticks ago, which the books are kept by, if it went on as it did; None: nobody knows.

        No sample came for a while, or it is older than usual: asked for before ticks that were skipped, or answered late. The
        next one puts right what is wrong. To stand still and catch up in one tick would be a jump that never was, and the
        damper's energy goes with its square.
        """
        if self.safety.state == "fault":
            return position
        if sample is not None and position is not None:
            return self._go_on(position, velocity, sample.age_ticks - self._latency)
        if self.tick - self._sampled > self._latency + self._reckon_ticks:
            return None
        return self._go_on(self.position_m, self.velocity_mps, elapsed)

    def _go_on(self, position_m: tuple[float, ...], velocity_mps: Sequence[float], ticks: int) -> tuple[float, ...]:
        step_s = ticks / self._rate
        return tuple([place + step_s * speed for place, speed in zip(position_m, velocity_mps, strict=True)])

    def _acting(self, elapsed: int) -> Sequence[float]:
        """The mean force over the ticks that are booked where samples are old: `elapsed` of them, up to `latency` ago."""
        forces, force = self._forces, self.force_n
        if elapsed == 1:
            acting = forces[0]
            forces.append(force)  # drops the oldest
            return acting
        acted = [*forces, *[force] * elapsed][:elapsed]
        forces.extend([force] * elapsed)
        return [sum(parts) / elapsed for parts in zip(*acted, strict=True)]

    def _book(self, elapsed: int, position: tuple[float, ...] | None) -> bool:
        """Book `elapsed` ticks; the hand was at `position` `latency` ticks ago. True if there is a frame to send."""
        coupling = self.coupling
        force = self._acting(elapsed) if self._latency and elapsed else self.force_n
        if isinstance(coupling, PassivityControl):
            coupling.applied_n = force
        if position is None or not elapsed:
            mean: Sequence[float] = (0.0,) * len(self.position_m)
        else:
            rate = self._rate / elapsed
            work = 0.0
            mean = []
            before = self.position_m
            for axis, place in enumerate(position):
                step = place - before[axis]
                work += force[axis] * step
                mean.append(step * rate)
            self.work_j, self._work_error_j = add_compensated(self.work_j, self._work_error_j, work)
        first = self.tick - elapsed + 1
        border, velocity = False, self.velocity_mps
        faulty, hold = self.safety.state == "fault", 1.0
        if self._stopped is None:
            self._parting = mean
        else:  # a hand whose force fades runs off: the line hears of one that goes on as it did, and lets go
            hold = max(0.0, 1.0 - (self.tick - self._stopped) / (LET_GO_S * self._rate))
            velocity = mean = self._parting
        ticks_per_frame = self._ticks_per_frame
        for tick in range(first, self.tick + 1):
            if border:  # a frame border inside the ticks that were skipped
                coupling.start_frame()
            if faulty:
                coupling.elapse_absent()
            else:
                coupling.elapse(mean, velocity, hold)
            border = tick % ticks_per_frame == 0
            if border:
                self.port.book(self.work_j, self._given_j + coupling.given_border_j)
                coupling.end_frame(self.port.spare_j)
                self._frame(position)
        self.port.book(self.work_j, self._given_j + coupling.given_j)
        self.leak_j = leak = self.work_j - (self._past.port_j + coupling.port_j)
        if leak < self.least_leak_j:
            self.least_leak_j = leak
        return border or elapsed >= ticks_per_frame

    def _frame(self, position: tuple[float, ...] | None) -> None:
        if position is None:
            return
        self.travel_m += dist(position, self._frame_position)
        self.port.end_frame(self._frame_position, position, self._ticks_per_frame / self._rate, self.coupling.stored_j)
        self._frame_position = position
        if self._rest is not None and self.safety.state == "live":  # not while the force is let go
            assert self.seat is not None
            side = self.seat.side_sign
            self._rest.add(side * position[0], side * self.force_n[0])

    def _send(self, now_ns: int) -> None:
        if self.session.state != "seated":
            return
        assert self._origin is not None
        message = self.coupling.message(
            self._session_id, self.session.clock.stamp(now_ns), self._origin, self.position_m, self.velocity_mps
        )
        self.outbox.append(encode(message))

    def act(self, now_ns: int) -> tuple[float, ...]:
        """The force [N], shape (axes,), to hold until the next tick: F of P eq. 9, which loads the hand."""
        coupling = self.coupling
        if self.tick % self._ticks_per_frame == 0:
            coupling.start_frame()
            if coupling.implausible:
                self.safety.note("wave beyond what the device can bring about")
            if (
                coupling.played
            ):  # records come in clumps: what was in hand, and is played in its time, is as good as new
                self.session.mark_fresh(now_ns)
        self._acted = self.tick
        if self.session.state == "resuming" or self.session.stale(now_ns):
            self.safety.event("stale", "nothing new from the server")
        elif self.safety.state == "degraded" and not self.port.resting:
            self.safety.event("fresh")
        force = self._render()
        step = abs(force[0] - self.force_n[0]) if len(force) == 1 else dist(force, self.force_n)
        if step > self.peak_step_n:
            self.peak_step_n = step
        self.force_n = force
        size = abs(force[0]) if len(force) == 1 else hypot(*force)
        if size > self.peak_force_n:
            self.peak_force_n = size
        return force

    def _render(self) -> tuple[float, ...]:
        """The law's force, as far as the device port and safety let it."""
        coupling = self.coupling
        safety, port = self.safety, self.port
        port.elapse()
        coupling.carried_nspm = port.carried_nspm
        wish = coupling.force(self.position_m, self.velocity_mps) if safety.state != "fault" else None
        if wish is not None and (paying := port.paying_nspm):
            wish = [law + paying * speed for law, speed in zip(wish, self.velocity_mps, strict=True)]
        force = safety.limit(port.limit(wish) if wish is not None else None, coupling.gap)
        coupling.gain = safety.gain
        port.ramped = not safety.full
        coupling.cut_n = None
        if wish is not None and safety.state == "live":
            local_n = coupling.local_n
            if port.ramped:
                local_n = [safety.gain * local for local in local_n]
            elif (kept := safety.law_n) is not wish:  # what limits took, the line is not told of either
                coupling.cut_n = [law - left for law, left in zip(wish, kept, strict=True)]
            if found := port.watch(force, safety.at_peak, local_n, safety.limited, coupling.reduced):
                self._let_go(found)
        return force

    def _let_go(self, found: Trouble) -> None:
        """Degrade, or fault if that goes on."""
        assert self.seat is not None
        safety, reason = self.safety, cure(found, self.seat, self.capability)
        safety.note(f"let go: {found}")
        if self.port.goes_on:
            safety.diverged = safety.diverged or reason
            safety.fail(f"{reason}, then re-arm")
        else:
            safety.event("stale", reason)

    def acted(self, force_n: tuple[float, ...]) -> None:
        """The device gives this force, not the one that `act` asked for: the books are to hold what the hand feels."""
        self.safety.note("force limited by the device")
        self.force_n = force_n

    @property
    def _late_frames(self) -> float:
        """How long a tick waits to be booked where samples are old: it makes the line softer (exactly so with the boxcar)."""
        assert self.seat is not None
        return self._latency / self._ticks_per_frame if self.seat.coupling.encoder == "displacement" else 0.0

    @property
    def port_j(self) -> float:
        """Energy that went into all lines so far."""
        return self._past.port_j + self.coupling.port_j

    @property
    def down_margin_j(self) -> float | None:
        """Least margin of the lines down so far; None without waves."""
        return self.coupling.down_margin_j

    @property
    def lost(self) -> int:
        """Frames from the server that were lost so far."""
        return self._past.lost(self.coupling)

    @property
    def diverged(self) -> str:
        """Why this end has diverged, "" if it has not."""
        return self.safety.diverged if self.seat is not None else ""

    def account(self, ticks: TickCount) -> ClientAccount:
        """Everything this end knows, for the summary and for the server."""
        return account_of(self, ticks)

    def predicted_stiffness(self) -> float | None:
        """Return the stiffness felt at rest, by the loop as measured last [N/m]; None where no wave went round."""
        assert self.seat is not None
        loop = self.coupling.loop_frames()
        return None if loop is None else self.seat.predicted_stiffness(loop, self._late_frames)

    @property
    def felt_stiffness(self) -> float | None:
        """As measured at rest on a wall [N/m]."""
        return self._rest.stiffness_npm() if self._rest else None

    def line_account(self) -> tuple[LinkCount, PlayoutAccount | None, float | None]:
        """Count the frames that came down on all lines; how they were played out; the least reserve after first seconds [J]."""
        return self._past.account(self.coupling)
