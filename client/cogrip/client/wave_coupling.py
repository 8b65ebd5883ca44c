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

from cogrip.client.coupling import Coupling, PortEnergy, Row
from cogrip.client.series_impedance import SeriesImpedance
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.decimation import make_decimator
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_fraction
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import SeatSettings
from cogrip.protocol.waves import device_gain, wave_of

COMPENSATED_FRACTION = 1.0 / 16.0  # fraction of what was withheld that a frame compensates
Held = tuple[tuple[float, ...], float, float, Sequence[float] | None]
"""Returning wave of a tick, its gain s, the ratio r of impedances, and what limits took from the force."""
OPEN = 0.5  # fraction of a wave that a released end reflects: with more it yields more, and swings more


class WaveCoupling(Coupling[Waves]):
    """The client's end of a wave line in each direction."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        axes, rates, coupling = seat.object.axes, seat.rates, seat.coupling
        self._b = coupling.impedance_nspm
        self._root = device_gain(self._b)
        self._half_tick_s = 0.5 * rates.tick_s
        self._ticks_per_frame = rates.ticks_per_frame
        self._from_displacement = coupling.encoder == "displacement"
        self._decimator = make_decimator(
            coupling.decimator, axes, rates.ticks_per_frame, rates.tick_s, coupling.lowpass_rad_s
        )
        self._sender = LineSender(axes, seat.playout.redundancy)
        playout = seat.playout
        self._receiver = LineReceiver(
            axes, playout.frames, rates.frame_s, playout.tank_mj * 1e-3, playout.concealment
        )  # fmt: skip
        self._line_gain = 1.0  # s of this frame
        self._written_off = [0.0] * axes  # sum of e over the ticks of this frame
        self._zero = (0.0,) * axes
        self._late: deque[Held] = deque(maxlen=0)  # of the last L ticks, oldest first
        self._most_wave = inf
        self._series = SeriesImpedance(axes, rates.tick_s)
        self._withheld = [0.0] * axes  # sum of what frames lacked the energy for
        self._ratio = 1.0  # r of this tick
        self._given = CompensatedSum()  # energy that the line gave, less what it took, up to the last frame that ended
        self._loops = LoopMeter(rates.network_hz)  # of the last second
        self._frame = 0
        self.forward: Sequence[float] = (0.0,) * axes  # u of the last tick
        self.energy = PortEnergy()
        self._rounding = rounding_fraction(rates.ticks_per_frame)
        self.down_reserve = EnergyReserve(rates.network_hz)

    @property
    def port_j(self) -> float:
        return self.energy.port_j

    def fit(self, record: Capability, lag_s: float) -> None:
        """Go by this device. Waves are plausible up to its speed, at twice its peak force: (b v_m + 2 F) / sqrt(2b)."""
        self._most_wave = wave_of(self._b, record.speed_mps, 2.0 * record.peak_force_n)

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on. A velocity sample goes with the wave of its own force."""
        keep = ticks if self._from_displacement else 0
        self._late = deque([*[(self._zero, 1.0, 1.0, None)] * keep, *self._late], maxlen=keep)

    def _entered(self) -> Held:
        """Return what belongs to the tick that is entered."""
        held = (self.returning, self._line_gain, self._ratio, self.cut_n)
        late = self._late
        if not late:
            return held
        oldest = late[0]
        late.append(held)  # drops the oldest
        return oldest

    @property
    def gap(self) -> bool:
        return self._receiver.gap

    def elapse(self, mean_velocity_mps: Sequence[float], velocity_mps: Sequence[float], hold: float = 1.0) -> None:
        """Enter a tick. At hold = 0 the line's end is half open (u = v would be a free one): the object is almost free."""
        root = self._root
        forward = []
        made = used = 0.0
        velocity = mean_velocity_mps if self._from_displacement else velocity_mps
        wave, gain, ratio, cut = self._entered()
        if ratio != 1.0 or cut is not None or self._series.deflected:
            impedance = gain * gain * self._b
            per_wave = (1.0 - ratio) * gain * self._root / impedance
            velocity = self._series.port_velocity(velocity, wave, impedance, per_wave, ratio, cut)
        if gain != 1.0:
            root *= gain
            kept = hold * (self._root - root)
            for axis in range(len(wave)):
                self._written_off[axis] += kept * velocity[axis]
        for axis, v in enumerate(wave):
            u = root * velocity[axis] - v
            if hold != 1.0:
                u = hold * u + (1.0 - hold) * OPEN * v
            forward.append(u)
            made += u * u
            used += v * v
        self._decimator.push(forward)
        self.forward = forward
        self.energy.made_now_j += made * self._half_tick_s
        self.energy.used_now_j += used * self._half_tick_s

    def elapse_absent(self) -> None:
        """Enter a tick without a hand: send 0, absorb what comes (a matched termination)."""
        self.forward = self._zero
        self._series.reset()
        self._decimator.push(self.forward)
        for v in self._entered()[0]:
            self.energy.used_now_j += v * v * self._half_tick_s

    def end_frame(self, spare_j: float = inf) -> None:
        """Send the wave of the frame that ends, of at most `spare_j` more energy than the frame brought.

        What is withheld is sent later, a part a frame, out of what is spare then.
        """
        sent = self._decimator.take()
        mean, held = sent, self._withheld
        if any(held):
            sent = tuple([u + COMPENSATED_FRACTION * h for u, h in zip(mean, held, strict=True)])
        half_frame_s = self._half_tick_s * self._ticks_per_frame
        brought = half_frame_s * sum([v * v for v in self.returning])
        going = half_frame_s * sum([u * u for u in sent])
        most = max(0.0, spare_j + brought)
        if going > most:
            scale = sqrt(most / going)
            sent = tuple([scale * u for u in sent])
            going *= scale * scale
        if sent is not mean:
            self._withheld = [h + u - out for h, u, out in zip(held, mean, sent, strict=True)]
            self.energy.made_now_j = max(self.energy.made_now_j, going)
        self._given.add(brought - going)
        self.sent = sent
        self._sender.push(sent)
        self.energy.end_frame()

    def start_frame(self) -> None:
        """Play the returning wave of the next frame, held over its ticks: lossless (P eq. 3-5)."""
        self._frame += 1
        receiver = self._receiver
        if any(self._written_off):
            receiver.write_off([e / self._ticks_per_frame for e in self._written_off])
            self._written_off = [0.0] * len(self._written_off)
        self.returning = wave = receiver.pop()
        most = self._most_wave
        self.implausible = max(wave) > most or min(wave) < -most
        if self.implausible:
            self.returning = tuple([min(max(v, -most), most) for v in wave])
        self._line_gain = receiver.gain
        self.down_reserve.elapse()
        if receiver.metadata is not None:
            made_j, _, acknowledged = receiver.metadata
            margin = made_j - receiver.played_j + self._rounding * made_j
            self.down_reserve.update(margin)
            if self.down_margin_j is None or margin < self.down_margin_j:
                self.down_margin_j = margin
            if acknowledged:
                self._loops.add(self._frame - acknowledged)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """Return F = b xdot - sqrt(2b) v (P eq. 16), with the velocity estimated now."""
        b, root, gain, deflected = self._b, self._root, self._line_gain, self._series.deflected
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
        return [local - root * wave for local, wave in zip(local_n, self.returning, strict=True)]

    @property
    def given_border_j(self) -> float:
        return self._given.value

    @property
    def given_j(self) -> float:
        """Energy that the line gave, with the frame under way: the line takes no more of it than this."""
        return self._given.value - (self.energy.made_now_j - self.energy.used_now_j)

    def message(
        self, session: int, stamp: Stamp, origin_m: Row, position_m: Row, velocity_mps: Sequence[float]
    ) -> Waves:  # fmt: skip
        first, waves, total, squares = self._sender.contents()
        return Waves(
            session, first, waves, total, squares, self.energy.made_j, self.port_j, self._receiver.acknowledged, stamp,
            origin_m + position_m,
        )  # fmt: skip

    def receive(self, message: Waves) -> bool:
        if len(message.state) != len(self.object_state):
            return False
        metadata = (message.made_j, message.port_j, message.acknowledged)
        fits = self._receiver.receive(message.first, message.waves, message.total, message.squares, metadata)
        if fits:
            self.object_state = message.state
        return fits

    @property
    def played(self) -> bool:
        return self._receiver.played

    @property
    def newest(self) -> int:
        return self._receiver.newest

    @property
    def deficit(self) -> list[float]:
        """Sum of the returning waves that were sent and not played, shape (axes,) [sqrt(W)]."""
        return self._receiver.deficit

    def lost(self) -> int:
        return self._receiver.lost

    @property
    def playout_frames(self) -> int:
        return self._receiver.playout_frames

    def playout_account(self) -> PlayoutAccount | None:
        return self._receiver.playout_account()

    def count(self) -> LinkCount:
        return self._receiver.count()

    def loop_frames(self) -> float | None:
        """Return the measured loop of the last second: frames from a forward wave to the frame its answer is applied in."""
        return self._loops.median()
