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

from collections import deque
from collections.abc import Sequence
from math import inf, sqrt
from operator import sub

from cogrip.client.coupling import Coupling, DelayLine, PortEnergy, Row
from cogrip.client.series_impedance import SeriesImpedance
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.decimation import make_decimator
from cogrip.protocol.line.energy_ledger import HISTORY
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_fraction
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import SeatSettings
from cogrip.protocol.waves import device_gain, wave_of

COMPENSATED_FRACTION = 1.0 / 16.0  # fraction of what was withheld that a frame compensates
Held = tuple[Row, float, float, Sequence[float] | None]
"""Returning wave of a tick, its gain s, the ratio r of impedances, and what limits took from the force."""
QUIET = 256  # frames for which two ticks must be spare before frames are sent later by one; fewer where more is spare
PRESSING = 64  # frames for which one must be lacking before frames are sent sooner
OPEN = 0.5  # fraction of a wave that a released end reflects: with more it yields more, and swings more


class ForwardLine:
    """Uplink: the wave of each frame, decimated from those of its ticks (`decimator`); what lacked energy waits here.

    energy   through the port, `made_now_j` and `used_now_j` set tick by tick
    given_j  energy that the line gave, less what it took, up to the last frame that ended
    ticks    of the line so far
    phase    ticks by which the newest frame ended later than frames of M ticks would have
    spare    ticks by which the server says that frames may be sent later; below 0: should be sent sooner
    """

    def __init__(self, seat: SeatSettings) -> None:
        axes, rates, coupling = seat.object.axes, seat.rates, seat.coupling
        self.decimator = make_decimator(
            coupling.decimator, axes, rates.ticks_per_frame, rates.tick_s, coupling.lowpass_rad_s
        )
        self.sender = LineSender(axes, seat.playout.redundancy)
        self.energy = PortEnergy()
        self.frame_ticks = rates.ticks_per_frame
        self._half_frame_s = 0.5 * rates.tick_s * rates.ticks_per_frame
        self._withheld = [0.0] * axes  # sum of what frames lacked the energy for
        self._given = CompensatedSum()
        self.ticks = self.phase = self.spare = 0
        self._ends: deque[int] = deque(maxlen=HISTORY)  # ticks at which the newest frames ended
        self._shift = 0  # ticks that the frame under way has more than M
        self._shifted: int | None = None  # number of the first frame with the present phase
        self._asked = 0  # sum of what was spare in each frame, since the sign changed

    @property
    def given_j(self) -> float:
        return self._given.value

    def end_frame(self, spare_j: float) -> Row:
        """Send the wave of the frame that ends, of at most `spare_j` more energy than came through the port; and return it.

        What is withheld is sent later, a part a frame, out of what is spare then. A frame of more ticks than M has the integral
        of all of them, and so may have more energy than they had: that too is asked of `spare_j`.
        """
        self.phase += self._shift
        sent = self.decimator.take()
        mean, held = sent, self._withheld
        if any(held):
            sent = tuple([u + COMPENSATED_FRACTION * h for u, h in zip(mean, held, strict=True)])
        brought = self.energy.used_now_j
        going = self._half_frame_s * sum([u * u for u in sent])
        most = max(0.0, spare_j + brought)
        if going > most:
            scale = sqrt(most / going)
            sent = tuple([scale * u for u in sent])
            going *= scale * scale
        if sent is not mean:
            self._withheld = [h + u - out for h, u, out in zip(held, mean, sent, strict=True)]
        if sent is not mean or self._shift > 0:
            self.energy.made_now_j = max(self.energy.made_now_j, going)
        self._given.add(brought - going)
        self.sender.push(sent)
        self.energy.end_frame()
        self._ends.append(self.ticks)
        return sent

    def withhold(self, waves: Sequence[float], *, anew: bool = False) -> None:
        """Add to what waits to be sent, a sum over frames, shape (axes,) [sqrt(W)]. anew: in place of what has waited."""
        self._withheld = list(waves) if anew else [h + u for h, u in zip(self._withheld, waves, strict=True)]

    def next_length(self, acknowledged: int) -> int:
        """Return the ticks of the next frame: M, or as many more or fewer as shift the phase by what is spare.

        acknowledged: frames that the server had played when it said so. All at once at first; then by one tick, when the server
        has heard of the last shift and has said so for a while (QUIET, PRESSING).
        """
        self._shift, spare = 0, self.spare
        if spare > 0:
            spare -= 1  # a single tick is not worth a shift: jitter soon takes it back
        self._asked = self._asked + spare if self._asked * spare > 0 else spare
        if self._shifted is None:
            if self.spare and acknowledged:
                self._shift = max(-1, min(self.frame_ticks - 1, self.spare))
        elif acknowledged > self._shifted and not -PRESSING <= self._asked <= QUIET:
            self._shift = 1 if spare > 0 else -1
        if self._shift + self.frame_ticks < 1:
            self._shift = 0
        if self._shift:
            self._shifted, self._asked = self.sender.next_number, 0
        return self.frame_ticks + self._shift

    def since(self, number: int) -> int | None:
        """Return the ticks since frame `number` ended; None for one that is not known any more."""
        place = number - self.sender.next_number
        return self.ticks - self._ends[place] if -len(self._ends) <= place < 0 else None


class ReturningLine:
    """Downlink: the wave of each frame, and the account that came with it.

    gain         s of this frame
    written_off  sum of e over the ticks of this frame, shape (axes,)
    margin_j     energy margin that this frame reported, None where none did
    """

    def __init__(self, seat: SeatSettings) -> None:
        axes, rates, playout = seat.object.axes, seat.rates, seat.playout
        self.receiver = LineReceiver(
            axes, playout.frames, rates.frame_s, playout.tank_mj * 1e-3, playout.concealment,
            late=playout.late, ticks=rates.ticks_per_frame,
        )  # fmt: skip
        self.gain = 1.0
        self.written_off = [0.0] * axes
        self.margin_j: float | None = None
        self.reserve = EnergyReserve(rates.network_hz)
        self._ticks_per_frame = rates.ticks_per_frame
        self._rounding = rounding_fraction(rates.ticks_per_frame)

    def pop(self) -> Row:
        """Return the wave of the next frame."""
        receiver = self.receiver
        if any(self.written_off):
            receiver.write_off([e / self._ticks_per_frame for e in self.written_off])
            self.written_off = [0.0] * len(self.written_off)
        wave = receiver.pop()
        self.gain, self.margin_j = receiver.gain, None
        self.reserve.elapse()
        if receiver.metadata is not None:
            made_j, _, _ = receiver.metadata
            self.margin_j = margin = made_j - receiver.played_j + self._rounding * made_j
            self.reserve.update(margin)
        return wave


class WaveCoupling(Coupling[Waves]):
    """The client's end of a wave line in each direction, `up` and `down`. forward: u of the last tick; late: its ticks."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        axes, tick_s, coupling = seat.object.axes, seat.rates.tick_s, seat.coupling
        self._b = coupling.impedance_nspm
        self._root = device_gain(self._b)
        self._half_tick_s = 0.5 * tick_s
        self._from_displacement = coupling.encoder == "displacement"
        self._most_wave = inf
        self.late: DelayLine[Held] = DelayLine()
        self._series = SeriesImpedance(axes, tick_s)
        self._ratio = 1.0  # r of this tick
        self._acknowledged = 0  # frames that the server had played when it sent its newest message
        self._began = 0  # tick of the line at which the wave began to be applied
        self._applied = 0  # ticks for which the wave from the server had been applied when the newest frame ended
        self.forward: Sequence[float] = (0.0,) * axes
        self.up, self.down = ForwardLine(seat), ReturningLine(seat)
        self.energy = self.up.energy
        self.loops = LoopMeter(seat.rates.network_hz, seat.rates.ticks_per_frame)
        self.down_reserve = self.down.reserve

    @property
    def port_j(self) -> float:
        return self.energy.port_j

    def fit(self, record: Capability, lag_s: float) -> None:
        """Go by this device. Waves are plausible up to its speed, at twice its peak force: (b v_m + 2 F) / sqrt(2b)."""
        self._most_wave = wave_of(self._b, record.speed_mps, 2.0 * record.peak_force_n)

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on. A velocity sample goes with the wave of its own force."""
        self.late.set_ticks(ticks if self._from_displacement else 0, ((0.0,) * len(self.sent), 1.0, 1.0, None))

    @property
    def gap(self) -> bool:
        return self.down.receiver.gap

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Enter a tick. At hold = 0 the line's end is half open (u = v would be a free one): the object is almost free."""
        root, down = self._root, self.down
        self.up.ticks += 1
        forward = []
        made = used = 0.0
        velocity = mean_velocity_mps if self._from_displacement else velocity_mps
        wave, gain, ratio, cut = self.late.push((self.returning, down.gain, self._ratio, self.cut_n))
        if ratio != 1.0 or cut is not None or self._series.deflected:
            impedance = gain * gain * self._b
            per_wave = (1.0 - ratio) * gain * self._root / impedance
            velocity = self._series.port_velocity(velocity, wave, impedance, per_wave, ratio, cut)
        if gain != 1.0:
            root *= gain
            kept = hold * (self._root - root)
            for axis in range(len(wave)):
                down.written_off[axis] += kept * velocity[axis]
        for axis, v in enumerate(wave):
            u = root * velocity[axis] - v
            if hold != 1.0:
                u = hold * u + (1.0 - hold) * OPEN * v
            forward.append(u)
            made += u * u
            used += v * v
        self.up.decimator.push(forward)
        self.forward = forward
        self.energy.made_now_j += made * self._half_tick_s
        self.energy.used_now_j += used * self._half_tick_s

    def elapse_absent(self) -> None:
        """Enter a tick without a hand: send 0, absorb what comes (a matched termination)."""
        self.up.ticks += 1
        self.forward = (0.0,) * len(self.sent)
        self._series.reset()
        self.up.decimator.push(self.forward)
        for v in self.late.push((self.returning, self.down.gain, self._ratio, self.cut_n))[0]:
            self.energy.used_now_j += v * v * self._half_tick_s

    def end_frame(self, spare_j: float = inf) -> int:
        self.sent = self.up.end_frame(spare_j)
        self._applied = self.up.ticks - self._began
        return self.up.next_length(self._acknowledged)

    def start_frame(self) -> int:
        """Play the returning wave of the next frame, held over its ticks: lossless (P eq. 3-5)."""
        self.down.receiver.answer = self.sent
        self._play(self.down.pop())
        self._began = self.up.ticks
        receiver = self.down.receiver
        if receiver.metadata is not None and (acknowledged := receiver.metadata[2]):
            since = self.up.since(acknowledged - 1)
            if since is not None:
                self.loops.add(since + self.up.frame_ticks)
        margin = self.down.margin_j
        if margin is not None and (self.down_margin_j is None or margin < self.down_margin_j):
            self.down_margin_j = margin
        return receiver.hold

    def _play(self, wave: Row) -> None:
        most = self._most_wave
        self.implausible = max(wave) > most or min(wave) < -most
        self.returning = tuple([min(max(v, -most), most) for v in wave]) if self.implausible else wave

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """Return F = b xdot - sqrt(2b) v (P eq. 16), with the velocity estimated now."""
        b, root, gain, deflected = self._b, self._root, self.down.gain, self._series.deflected
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
        self.local_n = local_n = [b * velocity for velocity in velocity_mps]
        return list(map(sub, local_n, [root * wave for wave in self.returning]))

    @property
    def given_border_j(self) -> float:
        return self.up.given_j

    @property
    def given_j(self) -> float:
        """Energy that the line gave, with the frame under way: the line takes no more of it than this."""
        return self.up.given_j - (self.energy.made_now_j - self.energy.used_now_j)

    def message(
        self, session: int, stamp: Stamp, origin_m: Row, position_m: Row, velocity_mps: Sequence[float]
    ) -> Waves:
        first, waves, total, squares = self.up.sender.contents()
        acknowledged, state = self.down.receiver.acknowledged, origin_m + position_m
        return Waves(
            session, first, waves, total, squares, self.energy.made_j, self.port_j, acknowledged, stamp, state, self.up.phase,
            self._applied,
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
            if receiver.overdue is not None and early:
                self._play(receiver.play_overdue(early))
        return fits

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
    def owed_frames(self) -> float:
        square = sum([v * v for v in self.returning])
        return sum([d * v for d, v in zip(self.deficit, self.returning, strict=True)]) / square if square else 0.0

    def lost(self) -> int:
        return self.down.receiver.lost

    @property
    def playout_frames(self) -> float:
        return self.down.receiver.playout_frames

    def playout_account(self) -> PlayoutAccount | None:
        return self.down.receiver.playout_account()

    def count(self) -> LinkCount:
        return self.down.receiver.count()

    def loop_frames(self) -> float | None:
        """Return the measured loop of the last second: frames from a forward wave to the frame its answer is applied in."""
        return self.loops.median()
