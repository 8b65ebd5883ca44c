"""The client's end of the wave scheme (theory sections 1, 3.2, 3.6).

Symbols, per axis: b impedance [N s/m], y mean velocity of a tick [m/s], v returning wave held over a frame [sqrt(W)],
u = sqrt(2b) y - v forward wave of a tick [sqrt(W)], T_c tick [s], L age of a sample [ticks]. Energies in J.

Where samples are old, a tick shows the displacement of L ticks before, which was made against the wave of then:
u_k = sqrt(2b) y_{k-L} - v_{k-L}. With the wave of now, displacement and force would not make up the hand's work at frame
borders, and the line would give the difference. Each wave is entered for its own M ticks all the same, L ticks late.

Where the returning wave is missing this end yields: with a gain s of sqrt(b), 1 on a clear line, F = s^2 b xdot - s sqrt(2b) v
and u = s sqrt(2b) y - v; F y = (u^2 - v^2)/2 holds tick by tick for any s. The rest of the displacement,
e = (1 - s) sqrt(2b) y, is written off: the receiver counts it as played (docs/decisions/0003-gaps.md).

Where the device carries less than b, `series_impedance` stands between hand and port: y is then the port's velocity y_p.
"""

from collections.abc import Sequence
from math import inf, sqrt
from operator import sub

from msgspec.structs import replace

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.line_tuner import LineTuner
from cogrip.client.coupling.series_impedance import SeriesImpedance
from cogrip.client.coupling.wave_lines import ForwardLine, ReturningLine
from cogrip.client.hand.felt_stiffness import REST_S
from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.rows.delay_line import DelayLine
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.axes import PLACES
from cogrip.protocol.laws.waves import device_gain, wave_of
from cogrip.protocol.line.line_in_use import ImpedanceChanges
from cogrip.protocol.line.loop_meter import LoopMeter
from cogrip.protocol.line.waves_encoding import encode_waves
from cogrip.protocol.settings.hand import HandChange
from cogrip.protocol.settings.line_tuning import Tuning, corner_hz
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.accounts import LineAccount, LinkCount, PlayoutAccount
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.handle import Handle
from cogrip.protocol.wire.messages import Waves

Held = tuple[Row, float, float, Sequence[float] | None, float]
"""Returning wave of a tick, its gain s, the ratio r of impedances, what limits took from the force, and b."""
OPEN = 0.5  # fraction of a wave that a released end reflects: with more it yields more, and swings more


class WaveCoupling(Coupling):
    """The client's end of a wave line in each direction, `up` and `down`.

    b, root  impedance b [N s/m] in use, and sqrt(2b)
    forward  u of the last tick
    late     waves that wait for their ticks, where samples are old
    """

    __slots__ = (
        "_acknowledged",
        "_answered",
        "_applied",
        "_began",
        "_device_nspm",
        "_filters_hz",
        "_from_displacement",
        "_half_tick_s",
        "_impedances",
        "_late_ticks",
        "_made_nspm",
        "_most_motion",
        "_most_wave",
        "_ratio",
        "_series",
        "_since",
        "_tick_s",
        "_tuner",
        "b",
        "down",
        "down_reserve",
        "energy",
        "forward",
        "late",
        "loops",
        "root",
        "up",
    )  # fmt: skip

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        self.absorbs = True
        axes, tick_s, coupling = seat.object.axes, seat.rates.tick_s, seat.coupling
        self._tick_s = tick_s
        self.b = coupling.impedance_nspm
        self.root = device_gain(self.b)
        self._half_tick_s = 0.5 * tick_s
        self._tuner = LineTuner(seat) if seat.line.live else None
        self._device_nspm = self.b  # impedance that the device carries
        self._since = 0  # number of the first frame with the impedance of now
        self._answered = ImpedanceChanges(self.b)  # of the returning frames, as they were made
        self._from_displacement = coupling.encoder == "displacement"
        self._most_wave = inf
        self._most_motion = inf, inf
        self.late: DelayLine[Held] = DelayLine()
        self._late_ticks = 0
        self._series = SeriesImpedance(axes, tick_s)
        self._ratio = 1.0  # r of this tick
        self._made_nspm = self.b  # with which the wave that plays now was made
        self._acknowledged = 0  # frames that the server had played when it sent its newest message
        self._began = 0  # tick of the line at which the wave began to be applied
        self._applied = 0  # ticks for which the wave from the server had been applied when the newest frame ended
        self.forward: Sequence[float] = (0.0,) * axes
        self.up, self.down = ForwardLine(seat), ReturningLine(seat)
        self.energy = self.up.energy
        self._impedances, self._filters_hz = (
            (self.b, self.b),
            (self._filter_hz, self._filter_hz),
        )  # least and most in use
        self.loops = LoopMeter(seat.rates.network_hz, seat.rates.ticks_per_frame)
        self.down_reserve = self.down.reserve

    @property
    def port_j(self) -> float:
        return self.energy.port_j()

    def entered_j(self) -> float:
        return self.energy.port_j()

    def fit(self, record: Capability, lag_s: float) -> None:
        """Go by this device. Waves are plausible up to its speed, at twice its peak force: (b v_m + 2 F) / sqrt(2b)."""
        self._most_motion = record.speed_mps, 2.0 * record.peak_force_n
        self._device_nspm = largest_impedance(record, self._tick_s).impedance_nspm
        if self._tuner is not None:
            self._tuner.carried_nspm = self._device_nspm
            if not self.up.sender.next_number:
                self.tune(self._tuner.begin())
        self._most_wave = wave_of(self.b, *self._most_motion)

    def go_on_from(self, before: Coupling) -> None:
        super().go_on_from(before)
        if not isinstance(before, WaveCoupling) or before._tuner is None:
            return
        if self._tuner is None:
            self._tuner = LineTuner(self._seat)
        self._tuner.go_on_from(before._tuner)

    def tune(self, found: Tuning) -> None:
        """Have this impedance and filter from the next frame on (theory 7.3)."""
        up, down, ratio = self.up, self.down, found.impedance_nspm / self.b
        lag_ticks = found.filter_lag_s / self._tick_s
        if not up.filter.lag_ticks == down.filter.lag_ticks == lag_ticks or ratio != 1.0:
            up.withhold([left / self.frame_ticks for left in up.filter.retune(lag_ticks, ratio)])
            down.receiver.write_off([-left / self.frame_ticks for left in down.filter.retune(lag_ticks, ratio)])
        begins = not up.sender.next_number
        least, most = (inf, -inf) if begins else self._filters_hz
        self._filters_hz = min(least, self._filter_hz), max(most, self._filter_hz)
        least, most = (inf, -inf) if begins else self._impedances
        self._impedances = min(least, found.impedance_nspm), max(most, found.impedance_nspm)
        if ratio == 1.0:
            return
        gain = min(1.0, 1.0 / sqrt(ratio))
        self.returning = tuple([gain * wave for wave in self.returning])
        self.b, self._since = found.impedance_nspm, up.sender.next_number
        self.root = device_gain(self.b)
        self._most_wave = wave_of(self.b, *self._most_motion)

    def change(self, seat: SeatSettings) -> None:
        if self._tuner is None:
            self._tuner = LineTuner(self._seat)
            self._tuner.carried_nspm = self._device_nspm
        self._tuner.change(seat)
        self._seat = seat

    def line_held(self) -> HandChange:
        return self._tuner.held() if self._tuner is not None else HandChange()

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on. A velocity sample goes with the wave of its own force."""
        self._late_ticks = ticks if self._from_displacement else 0
        self.late.set_ticks(self._late_ticks, ((0.0,) * len(self.sent), 1.0, 1.0, None, self.b))

    def gap(self) -> bool:
        return self.down.receiver.gap

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Enter a tick. At hold = 0 the line's end is half open (u = v would be a free one): the object is almost free."""
        up, down, energy = self.up, self.down, self.energy
        up.ticks += 1
        velocity = mean_velocity_mps if self._from_displacement else velocity_mps
        wave, gain, ratio, cut, b = self.returning, down.gain, self._ratio, self.cut_n, self.b
        if self._late_ticks:
            wave, gain, ratio, cut, b = self.late.push((wave, gain, ratio, cut, b))
        full = root = self.root if b == self.b else device_gain(b)
        if ratio != 1.0 or cut is not None or self._series.deflected:
            impedance = gain * gain * b
            per_wave = (1.0 - ratio) * gain * root / impedance
            velocity = self._series.port_velocity(velocity, wave, impedance, per_wave, ratio, cut)
        if gain != 1.0:
            root *= gain
            kept = hold * (full - root)
            for axis in range(len(wave)):
                down.written_off[axis] += kept * velocity[axis]
        forward: list[float] = []
        made = used = 0.0
        if hold == 1.0 and len(wave) == PLACES:  # as below, without a loop
            (vx, vy, vz), (x, y, z) = wave, velocity
            forward = [ux := root * x - vx, uy := root * y - vy, uz := root * z - vz]
            made = ux * ux + uy * uy + uz * uz
            used = vx * vx + vy * vy + vz * vz
        else:
            for axis, v in enumerate(wave):
                u = root * velocity[axis] - v
                if hold != 1.0:
                    u = hold * u + (1.0 - hold) * OPEN * v
                forward.append(u)
                made += u * u
                used += v * v
        up.decimator.push(forward)
        self.forward = forward
        energy.made_now_j += made * self._half_tick_s
        energy.used_now_j += used * self._half_tick_s

    def elapse_held(self) -> None:
        """Enter a tick of a tool that stands still, u = -v: sent as what was withheld is, part by part (`ForwardLine`).

        To reflect the wave as it comes would have a free object swing for ever.
        """
        self.up.withhold([-v / self.frame_ticks for v in self.returning])
        self.elapse_absent()

    def elapse_absent(self) -> None:
        """Enter a tick without a hand: send 0, absorb what comes (a matched termination)."""
        up, wave = self.up, self.returning
        up.ticks += 1
        self.forward = forward = (0.0,) * len(self.sent)
        self._series.reset()
        up.decimator.push(forward)
        if self._late_ticks:
            wave = self.late.push((wave, self.down.gain, self._ratio, self.cut_n, self.b))[0]
        for v in wave:
            self.energy.used_now_j += v * v * self._half_tick_s

    def end_frame(self, spare_j: float = inf) -> int:
        self.sent = self.up.end_frame(spare_j)
        self._applied = self.up.ticks - self._began
        if self._tuner is not None and (found := self._tuner.end_frame(self.loops)):
            self.tune(found)
        return self.up.next_length(self._acknowledged)

    def start_frame(self) -> int:
        """Play the returning wave of the next frame, held over its ticks: lossless (P eq. 3-5)."""
        self.down.receiver.answer = self.sent
        wave, receiver = self.down.pop(), self.down.receiver
        if self._tuner is not None:
            self._made_nspm = self._answered.at(receiver.acknowledged - 1)
        self._play(wave, receiver.hold)
        self._began = self.up.ticks
        if receiver.metadata is not None and (acknowledged := receiver.metadata.acknowledged):
            since = self.up.since(acknowledged - 1)
            if since is not None:
                self.loops.add(since + self.up.frame_ticks)
        margin = self.down.margin_j
        if margin is not None and (self.down_margin_j is None or margin < self.down_margin_j):
            self.down_margin_j = margin
        return receiver.hold

    def _play(self, wave: Row, ticks: int) -> None:
        most = self._most_wave
        if self._made_nspm != self.b:
            wave = self._read(wave, ticks)
        self.implausible = ""
        if max(wave) > most or min(wave) < -most:
            self.implausible = "wave beyond what the device can bring about"
            wave = tuple([min(max(v, -most), most) for v in wave])
        self.returning = self.down.filter.step(wave, ticks)

    def _read(self, wave: Row, ticks: int) -> Row:
        """Return a wave that was made with another impedance as one of this: scaled by at most 1 (theory 7.3)."""
        wanted = sqrt(self.b / self._made_nspm)
        return self.down.receiver.scale(wave, min(1.0, 1.0 / wanted), wanted, ticks)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """Return F = b xdot - sqrt(2b) v (P eq. 16), with the velocity estimated now."""
        b, root, gain, deflected = self.b, self.root, self.down.gain, self._series.deflected
        if gain != 1.0:
            b *= gain * gain
            root *= gain
        ratio = 1.0
        if self.carried_nspm < b or deflected:
            ratio = min(1.0, self.carried_nspm / b)
            b *= ratio
            root *= ratio
            velocity_mps = self._series.with_spring(velocity_mps)
        self._ratio = ratio
        self.reduced = ratio != 1.0 or deflected
        if len(velocity_mps) == PLACES:  # as below, without a loop
            (x, y, z), (vx, vy, vz) = velocity_mps, self.returning
            self.local_n = [fx := b * x, fy := b * y, fz := b * z]
            return [fx - root * vx, fy - root * vy, fz - root * vz]
        self.local_n = local_n = [b * velocity for velocity in velocity_mps]
        return list(map(sub, local_n, [root * wave for wave in self.returning]))

    def given_j(self) -> float:
        return self.up.given.value + self.energy.used_now_j

    def pending_j(self) -> float:
        """The frame's mean has no more energy than its ticks (Cauchy-Schwarz)."""
        return self.energy.made_now_j

    def message(
        self, session: int, clock: MessageClock, now_ns: int, origin_m: Row, position_m: Row, velocity_mps: Sequence[float],
        handle: Handle | None = None,
    ) -> bytes:  # fmt: skip
        tuned = self._tuner is not None
        return encode_waves(
            session, self.up.sender, self.energy.made_j, self.port_j, self.down.receiver.acknowledged, clock, now_ns,
            origin_m + position_m, self.up.phase, self.b if tuned else 0.0, self._since if tuned else 0, 0, self._applied,
            handle,
        )  # fmt: skip

    def receive(self, message: Waves) -> bool:
        if len(message.state) != len(self.object_state):
            return False
        metadata = (message.made_j, message.port_j, message.acknowledged)
        receiver = self.down.receiver
        early = max(0, receiver.hold - (self.up.ticks - self._began))
        fits = receiver.receive(message.first, message.waves, message.total, message.squares, metadata, early)
        if fits:
            self.object_state = message.state
            self.up.spare, self._acknowledged = message.phase, message.acknowledged
            if message.impedance_nspm:
                self._answered.add(message.since, message.impedance_nspm)
            if receiver.overdue is not None and early:
                self._play_overdue(early)
        return fits

    def _play_overdue(self, ticks: int) -> None:
        """Play a frame that has come while its filling was played, for the ticks that are left."""
        receiver = self.down.receiver
        if self._made_nspm != self.b:
            self._read(receiver.popped, -ticks)
        self.down.filter.cut(ticks)
        self._play(receiver.play_overdue(ticks), ticks)

    @property
    def played(self) -> bool:
        return self.down.receiver.played

    @property
    def newest(self) -> int:
        return self.down.receiver.newest

    @property
    def deficit(self) -> list[float]:
        """Sum of the returning waves that were sent and not played, shape (axes,) [sqrt(W)]."""
        return self.down.receiver.deficit

    @property
    def credit_left(self) -> float:
        return self.down.receiver.ledger.left

    @credit_left.setter
    def credit_left(self, left: float) -> None:
        ledger = self.down.receiver.ledger
        ledger.credit = min(ledger.credit, left)

    @property
    def deficit_frames(self) -> float:
        square = add_floats([v * v for v in self.returning])
        return (
            add_floats([d * v for d, v in zip(self.deficit, self.returning, strict=True)]) / square if square else 0.0
        )

    def lost(self) -> int:
        return self.down.receiver.lost

    @property
    def playout_frames(self) -> float:
        return self.down.receiver.playout_frames

    def recorded(self) -> tuple[float, int, float | None]:
        receiver = self.down.receiver
        return self.energy.port_j(), receiver.lost, receiver.playout_frames

    @property
    def _filter_hz(self) -> float:
        return corner_hz(self.up.filter.lag_ticks * self._tick_s)

    def seat_now(self) -> SeatSettings:
        seat = self._seat
        coupling, line = (
            replace(seat.coupling, impedance_nspm=self.b),
            replace(seat.line, wave_filter_hz=self._filter_hz),
        )
        return replace(seat, coupling=coupling, line=line)

    def line_account(self) -> LineAccount:
        return LineAccount(self.b, *self._impedances, self._filter_hz, *self._filters_hz)

    def playout_account(self) -> PlayoutAccount | None:
        return self.down.receiver.playout_account()

    def count(self) -> LinkCount:
        return self.down.receiver.count()

    def loop_frames(self) -> float | None:
        """Return the mean loop of the last REST_S: frames from a forward wave to the frame its answer is applied in."""
        return self.loops.mean(max(2, round(REST_S * self._seat.rates.network_hz)))
