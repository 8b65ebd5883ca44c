"""The client's end of the wave scheme (theory sections 1, 3.2, 3.6).

Symbols, per axis: b impedance [N s/m], y mean velocity of a tick [m/s], v returning wave held over a frame [sqrt(W)],
u = sqrt(2b) y - v forward wave of a tick [sqrt(W)], T_c tick [s], L age of a sample [ticks]. Energies in J.

Where samples are old, what a tick shows of the hand is the displacement of L ticks before, which was made against the wave
of then: u_k = sqrt(2b) y_{k-L} - v_{k-L}. With the wave of now, displacement and force would not make up the hand's work at
frame borders, and the line would give the difference. Each wave is booked for its own M ticks all the same, L ticks late.

Where the returning wave is missing this end yields: with a share s of sqrt(b), 1 on a clear line, F = s^2 b xdot - s sqrt(2b) v
and u = s sqrt(2b) y - v; F y = (u^2 - v^2)/2 holds tick by tick for any s. What that leaves of the displacement,
e = (1 - s) sqrt(2b) y, is forgone: the receiver holds it as played (docs/decisions/0003-gaps.md).

Where the device carries no more than r b, 0 < r < 1, a spring and a damper stand in series between hand and port,
w (RELAX_RAD_S) their ratio and z their deflection [m]: r b for fast motion, b for slow, and no creep.

    F = r (b (xdot + w z) - sqrt(2b) v)      y_p = r (y + w z) + (1 - r) sqrt(2/b) v - F_cut / b      z' = y - y_p

y_p is the port's velocity, u = sqrt(2b) y_p - v. F_cut is what limits took from the law's force: the line is not told of it,
and the deflection that it makes comes back by w. r = 1, z = 0 is the plain port. See docs/device_port.md.
"""

from collections import deque
from collections.abc import Sequence
from math import inf, sqrt

from cogrip.client.coupling import Coupling
from cogrip.devices.device import Capability
from cogrip.protocol.accounts import LinkCount, PlayoutAccount
from cogrip.protocol.decimation import make_decimator
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_share
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.loop_meter import LoopMeter
from cogrip.protocol.messages import Stamp, Waves
from cogrip.protocol.settings import SeatSettings

RELAX_RAD_S = 100.0  # w
LEAST_DEFLECTION_M, MOST_DEFLECTION_M = 1e-9, 0.05  # what slips beyond stays where it is
REPAID = 1.0 / 16.0  # of what was withheld, in a frame
Held = tuple[tuple[float, ...], float, float, Sequence[float] | None]
"""One tick's returning wave, the share s, the ratio of impedances, and what limits took from the force."""
OPEN = 0.5  # how much of a wave the end of a line sends back that has let go: more gives way more, and swings more


class WaveCoupling(Coupling[Waves]):
    """The client's end of a wave line in each direction."""

    def __init__(self, seat: SeatSettings) -> None:
        super().__init__(seat)
        axes, rates, coupling = seat.object.axes, seat.rates, seat.coupling
        self._b = coupling.impedance_nspm
        self._root = sqrt(2.0 * self._b)
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
        self._share = 1.0  # s of this frame
        self._written_off = [0.0] * axes  # sum of e over the ticks of this frame
        self._zero = (0.0,) * axes
        self._late: deque[Held] = deque(maxlen=0)  # of the last L ticks, oldest first
        self._most_wave = inf
        self._deflection_m = [0.0] * axes  # z
        self._deflected = False  # whether any z is not 0
        self._withheld = [0.0] * axes  # sum of what frames lacked the energy for
        self._ratio = 1.0  # of the impedance that is rendered to that of the port
        self._tick_s = rates.tick_s
        self._given = CompensatedSum()  # energy that the line gave, less what it took, up to the last frame that ended
        self._loops = LoopMeter(rates.network_hz)  # of the last second
        self._frame = 0
        self.forward: Sequence[float] = (0.0,) * axes  # u of the last tick
        self._made_j, self._used_j = CompensatedSum(), CompensatedSum()  # up to the last frame that ended
        self._made_now_j = self._used_now_j = 0.0  # since
        self._rounding = rounding_share(rates.ticks_per_frame)
        self.down_reserve = EnergyReserve(rates.network_hz)

    @property
    def made_j(self) -> float:
        """Energy of the forward waves of all ticks."""
        return self._made_j.value + self._made_now_j

    @property
    def used_j(self) -> float:
        """Energy of the returning waves of all ticks."""
        return self._used_j.value + self._used_now_j

    @property
    def port_j(self) -> float:
        return (self._made_j.value - self._used_j.value) + (self._made_now_j - self._used_now_j)

    def fit(self, record: Capability, lag_s: float) -> None:
        """Go by this device. Waves are believed up to its speed, at twice its peak force: (b v_m + 2 F) / sqrt(2b)."""
        self._most_wave = (self._b * record.speed_mps + 2.0 * record.peak_force_n) / self._root

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on. A velocity sample is booked with the wave that its force was made of."""
        keep = ticks if self._from_displacement else 0
        self._late = deque([*[(self._zero, 1.0, 1.0, None)] * keep, *self._late], maxlen=keep)

    def _booked(self) -> Held:
        """Return what belongs to the tick that is booked."""
        held = (self.returning, self._share, self._ratio, self.cut_n)
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
        """One tick has passed, with the displacement it shows / T_c and the velocity sample it began with.

        hold: how firmly a hand that takes its leave still holds, from 1 down to 0, where the line's end is half open
        (u = v would be a free one) and the object goes almost free.
        """
        root = self._root
        forward = []
        made = used = 0.0
        velocity = mean_velocity_mps if self._from_displacement else velocity_mps
        wave, share, ratio, cut = self._booked()
        if ratio != 1.0 or cut is not None or self._deflected:
            velocity = self._through_series(velocity, wave, share, ratio, cut)
        if share != 1.0:
            root *= share
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
        self._made_now_j += made * self._half_tick_s
        self._used_now_j += used * self._half_tick_s

    def _through_series(
        self,
        velocity_mps: Sequence[float],
        wave: Sequence[float],
        share: float,
        ratio: float,
        cut_n: Sequence[float] | None,
    ) -> list[float]:
        """Velocity of the port behind the series spring and damper, which take the rest of the hand's."""
        impedance = share * share * self._b
        per_wave = (1.0 - ratio) * share * self._root / impedance
        deflection, tick_s = self._deflection_m, self._tick_s
        behind, most = [], 0.0
        for axis, speed in enumerate(velocity_mps):
            port = ratio * (speed + RELAX_RAD_S * deflection[axis]) + per_wave * wave[axis]
            if cut_n is not None:
                port -= cut_n[axis] / impedance
            z = deflection[axis] + (speed - port) * tick_s
            deflection[axis] = z = min(max(z, -MOST_DEFLECTION_M), MOST_DEFLECTION_M)
            most = max(most, abs(z))
            behind.append(port)
        self._deflected = most > LEAST_DEFLECTION_M
        if not self._deflected:
            self._deflection_m = [0.0] * len(behind)
        return behind

    def elapse_absent(self) -> None:
        """One tick has passed without a hand: send 0, absorb what comes (a matched termination)."""
        self.forward = self._zero
        self._deflection_m, self._deflected = [0.0] * len(self._zero), False
        self._decimator.push(self.forward)
        for v in self._booked()[0]:
            self._used_now_j += v * v * self._half_tick_s

    def end_frame(self, spare_j: float = inf) -> None:
        """Send the wave of the frame that ends, of at most `spare_j` more energy than the frame brought.

        What that withholds is sent later, a part a frame, out of what is spare then.
        """
        sent = self._decimator.take()
        mean, held = sent, self._withheld
        if any(held):
            sent = tuple([u + REPAID * h for u, h in zip(mean, held, strict=True)])
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
            self._made_now_j = max(self._made_now_j, going)
        self._given.add(brought - going)
        self.sent = sent
        self._sender.push(sent)
        self._made_j.add(self._made_now_j)
        self._used_j.add(self._used_now_j)
        self._made_now_j = self._used_now_j = 0.0

    def start_frame(self) -> None:
        """The returning wave of the next frame, held over its ticks: lossless (P eq. 3-5)."""
        self._frame += 1
        receiver = self._receiver
        if any(self._written_off):
            receiver.write_off([e / self._ticks_per_frame for e in self._written_off])
            self._written_off = [0.0] * len(self._written_off)
        self.returning = wave = receiver.take()
        most = self._most_wave
        self.implausible = max(wave) > most or min(wave) < -most
        if self.implausible:
            self.returning = tuple([min(max(v, -most), most) for v in wave])
        self._share = receiver.share
        self.down_reserve.elapse()
        if receiver.mark is not None:
            made_j, _, heard = receiver.mark
            margin = made_j - receiver.played_j + self._rounding * made_j
            self.down_reserve.see(margin)
            if self.down_margin_j is None or margin < self.down_margin_j:
                self.down_margin_j = margin
            if heard:
                self._loops.add(self._frame - heard)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> list[float]:
        """F = b xdot - sqrt(2b) v [N] (P eq. 16), with the velocity estimated now."""
        b, root, share = self._b, self._root, self._share
        if share != 1.0:
            b *= share * share
            root *= share
        ratio = 1.0
        if self.carried_nspm < b or self._deflected:
            ratio = min(1.0, self.carried_nspm / b)
            b *= ratio
            root *= ratio
            velocity_mps = [v + RELAX_RAD_S * z for v, z in zip(velocity_mps, self._deflection_m, strict=True)]
        self._ratio = ratio
        self.reduced = ratio != 1.0 or self._deflected
        self.local_n = local_n = [b * velocity for velocity in velocity_mps]
        return [local - root * wave for local, wave in zip(local_n, self.returning, strict=True)]

    @property
    def given_border_j(self) -> float:
        """Energy that the line gave this end, less what it took, up to the last frame that ended."""
        return self._given.value

    @property
    def given_j(self) -> float:
        """The same with the frame under way, of which the line takes no more than this says."""
        return self._given.value - (self._made_now_j - self._used_now_j)

    def message(
        self, session: int, stamp: Stamp, origin_m: tuple[float, ...], position_m: tuple[float, ...],
        velocity_mps: Sequence[float],
    ) -> Waves:  # fmt: skip
        first, waves, total, squares = self._sender.contents()
        return Waves(
            session, first, waves, total, squares, self.made_j, self.port_j, self._receiver.heard, stamp,
            origin_m + position_m,
        )  # fmt: skip

    def receive(self, message: Waves) -> bool:
        if len(message.state) != len(self.object_state):
            return False
        mark = (message.made_j, message.port_j, message.heard)
        taken = self._receiver.receive(message.first, message.waves, message.total, message.squares, mark)
        if taken:
            self.object_state = message.state
        return taken

    @property
    def played(self) -> bool:
        return self._receiver.played

    @property
    def newest(self) -> int:
        return self._receiver.newest

    @property
    def deficit(self) -> list[float]:
        """Of the returning waves, shape (axes,) [sqrt(W)]: sent and not played."""
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
        """The measured loop of the last second: frames from a forward wave to the frame its answer is applied in."""
        return self._loops.median()
