"""The client's end of the line up, from the waves of ticks to frames, and of the line down, from frames to waves (SPEC 5)."""

from collections import deque
from collections.abc import Sequence
from math import sqrt

from cogrip.client.coupling.interface import PortEnergy
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.laws.decimation import make_decimator
from cogrip.protocol.line.energy_ledger import HISTORY
from cogrip.protocol.line.energy_reserve import EnergyReserve
from cogrip.protocol.line.energy_sums import CompensatedSum, rounding_fraction
from cogrip.protocol.line.receiver import LineReceiver
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.line.wave_filter import WaveFilter
from cogrip.protocol.settings.line_tuning import filter_lag_s
from cogrip.protocol.settings.seat import SeatSettings

COMPENSATED_FRACTION = 1.0 / 16.0  # fraction of what was withheld that a frame compensates
QUIET = 256  # frames for which two ticks must be spare before frames are sent later by one; fewer where more is spare
PRESSING = 64
"""Frames for which one tick must be lacking before frames are sent sooner by one; fewer where more is lacking."""


class ForwardLine:
    """Uplink: the wave of each frame, decimated from those of its ticks (`decimator`); what lacked energy waits here.

    energy   through the port, `made_now_j` and `used_now_j` set tick by tick
    given    energy that the line gave, less what it took, up to the last frame that ended
    ticks    of the line so far
    phase    ticks by which the newest frame ended later than frames of M ticks would have
    spare    ticks by which the server says that frames may be sent later; below 0: should be sent sooner
    """

    def __init__(self, seat: SeatSettings) -> None:
        axes, rates, coupling = seat.object.axes, seat.rates, seat.coupling
        self.decimator = make_decimator(
            coupling.decimator, axes, rates.ticks_per_frame, rates.tick_s, coupling.lowpass_rad_s
        )
        self.filter = WaveFilter(axes, filter_lag_s(seat.line.wave_filter_hz) / rates.tick_s)
        self.sender = LineSender(axes, seat.playout.redundancy)
        self.energy = PortEnergy()
        self.frame_ticks = rates.ticks_per_frame
        self._half_frame_s = 0.5 * rates.tick_s * rates.ticks_per_frame
        self._withheld = [0.0] * axes  # sum of what frames lacked the energy for
        self.given = CompensatedSum()
        self.ticks = self.phase = self.spare = 0
        self._ends: deque[int] = deque(maxlen=HISTORY)  # ticks at which the newest frames ended
        self._shift = 0  # ticks that the frame under way has more than M
        self._shifted: int | None = None  # number of the first frame with the present phase
        self._asked = 0  # sum of what was spare in each frame, since the sign changed

    def end_frame(self, spare_j: float) -> Row:
        """Send the wave of the frame that ends, of energy `spare_j` at most; and return it.

        What is withheld is sent later, a part a frame, out of what is spare then. A frame of more ticks than M has the integral
        of all of them, and so may have more energy than they had: that too is asked of `spare_j`.
        """
        self.phase += self._shift
        sent = self.filter.step(self.decimator.take(), self.frame_ticks)
        mean, held = sent, self._withheld
        if any(held):
            sent = tuple([u + COMPENSATED_FRACTION * h for u, h in zip(mean, held, strict=True)])
        brought = self.energy.used_now_j
        going = self._half_frame_s * add_floats([u * u for u in sent])
        most = max(0.0, spare_j)
        if going > most:
            scale = sqrt(most / going)
            sent = tuple([scale * u for u in sent])
            going *= scale * scale
        if sent is not mean:
            self._withheld = [h + u - out for h, u, out in zip(held, mean, sent, strict=True)]
        if sent is not mean or self._shift > 0:
            self.energy.made_now_j = max(self.energy.made_now_j, going)
        self.given.add(brought - going)
        self.sender.push(sent)
        self.energy.end_frame()
        self._ends.append(self.ticks)
        return sent

    def withhold(self, waves: Sequence[float], *, anew: bool = False) -> None:
        """Enter a sum of waves over frames that is to be sent as energy allows.

        anew: of the first axes, in place of all that has waited there.
        """
        if anew:
            self._withheld[: len(waves)] = waves
        else:
            self._withheld = [h + u for h, u in zip(self._withheld, waves, strict=True)]

    def next_length(self, acknowledged: int) -> int:
        """Return the ticks of the next frame: M, or as many more or fewer as shift the phase by what is spare.

        acknowledged: frames that the server had played when it said so. All at once at first; then by one tick, when the server
        has received the last shift and has said so for a while (QUIET, PRESSING).
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
        self.filter = WaveFilter(axes, filter_lag_s(seat.line.wave_filter_hz) / rates.tick_s)
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
            made_j = receiver.metadata.made_j
            self.margin_j = margin = made_j - receiver.played_j + self._rounding * made_j
            self.reserve.update(margin)
        return wave
