"""Energy ledger of one person: the hand's work, what the lines took and gave, and the difference.

Symbols: x position [m], F force held over a tick [N]. Energies in J.

    work_j  the hand's work against the force, sum of F (x_{k+1} - x_k): exact under the hold (theory section 3.6)
    leak_j  its part that did not go into a line or effects: b (y_est - y) y T_c a tick, y_est estimated and y mean velocity of
            the tick [m/s], T_c its length, b impedance or damping; and what safety took

A server that was started anew begins a new line. The ledger goes on over all lines: it keeps sums over the closed ones, and
adds what the coupling in use knows.
"""

from collections.abc import Sequence

import msgspec

from cogrip.client.coupling.interface import Coupling
from cogrip.client.rows.delay_line import DelayLine, mean_row
from cogrip.machine.addition import add_floats
from cogrip.protocol.line.energy_sums import CompensatedSum
from cogrip.protocol.wire.accounts import LinkCount, PlayoutAccount


class WorkAccount:
    """Accounts of a hand's work, through all lines that it has had.

    coupling     the one in use
    sources_j    work against the forces beside the coupling
    `closed_...` are sums over the lines before
    """

    def __init__(self, coupling: Coupling) -> None:
        self.coupling = coupling
        self.power_ratio = 1.0  # power at the hand by power into the line (`hand_map`)
        self.work = CompensatedSum()
        self.leak_j = self.least_leak_j = self.sources_j = 0.0
        self.closed_given_j = self.closed_port_j = self.closed_entered_j = (
            0.0  # by, into, by the hand into the closed lines
        )
        self._reserve_j: float | None = None
        self._lost = 0
        self._count = LinkCount()
        self._playout: PlayoutAccount | None = None
        self._forces: DelayLine[tuple[float, ...]] = DelayLine()

    @property
    def work_j(self) -> float:
        return self.work.value

    def set_latency(self, ticks: int) -> None:
        """Samples are `ticks` ticks old from now on."""
        self._forces.set_ticks(ticks, (0.0,) * len(self.coupling.sent))

    def elapse(self, elapsed: int, force_n: tuple[float, ...]) -> None:
        """Count ticks before there is a hand."""
        self._forces.push_many(force_n, elapsed)

    def acting(self, elapsed: int, force_n: tuple[float, ...]) -> Sequence[float]:
        """Return the mean force over the ticks that samples now show: `elapsed` of them, up to the latency ago."""
        return mean_row(self._forces, force_n, elapsed)

    def compare(self) -> None:
        """Compare the work with the energy that went into all lines."""
        self.leak_j = leak = self.work.value - (self.closed_entered_j + self.power_ratio * self.coupling.entered_j())
        if leak < self.least_leak_j:
            self.least_leak_j = leak

    def begin_line(self, coupling: Coupling) -> None:
        """Close the present line and go on with a new one. What the old one had received but not played is never played now."""
        before = self.coupling
        self._close(before, self.power_ratio)
        self._reserve_j, self._lost, self._playout = self.down_reserve_j, self.lost, self.playout_account()
        self._count = msgspec.structs.replace(self.count(), pending=0)
        coupling.go_on_from(before)
        self.coupling = coupling

    def _close(self, coupling: Coupling, power_ratio: float) -> None:
        self.closed_given_j += power_ratio * coupling.given_j()
        self.closed_port_j += power_ratio * coupling.port_j
        self.closed_entered_j += power_ratio * coupling.entered_j()

    def set_sources(self, work_j: float) -> None:
        """Count the hand's work against sources as entered, like that into closed lines."""
        self.closed_entered_j += work_j - self.sources_j
        self.sources_j = work_j

    def set_power_ratio(self, power_ratio: float) -> None:
        """Weigh what the line takes and gives so from now on."""
        self._close(self.coupling, self.power_ratio - power_ratio)
        self.power_ratio = power_ratio

    @property
    def given_j(self) -> float:
        """Energy at the hand that all lines gave, less what they took."""
        return self.closed_given_j + self.power_ratio * self.coupling.given_j()

    @property
    def port_j(self) -> float:
        """Energy that went into all lines."""
        return self.closed_port_j + self.power_ratio * self.coupling.port_j

    @property
    def down_reserve_j(self) -> float | None:
        """Least reserve after the first second of each line, None where no line was that long."""
        known = [each for each in (self._reserve_j, self.coupling.down_reserve.reported_j) if each is not None]
        return min(known, default=None)

    def recorded(self) -> tuple[float, int, float | None]:
        """Return what the record of a tick has of all lines, `port_j` and `lost`, and `playout_frames` of the one in use."""
        port_j, lost, playout_frames = self.coupling.recorded()
        return self.closed_port_j + self.power_ratio * port_j, self._lost + lost, playout_frames

    @property
    def lost(self) -> int:
        """Number of frames from the server that were lost."""
        return self._lost + self.coupling.lost()

    def count(self) -> LinkCount:
        """Count the frames that came down."""
        before, now = self._count, self.coupling.count()
        return LinkCount(**{name: getattr(before, name) + getattr(now, name) for name in LinkCount.__struct_fields__})

    def playout_account(self) -> PlayoutAccount | None:
        """Return how frames were played out, None without waves.

        The mean depth is that of all frames sent; a line that never began has no depth.
        """
        before, now = self._playout, self.coupling.playout_account()
        if before is None or now is None:
            return now
        frames, more = self._count.sent, self.coupling.count().sent
        depth = [(account, sent) for account, sent in ((before, frames), (now, more)) if sent] or [(before, 1)]
        return PlayoutAccount(
            depth_frames=add_floats(account.depth_frames * sent for account, sent in depth)
            / add_floats(sent for _, sent in depth),
            least_frames=min(account.least_frames for account, _ in depth),
            most_frames=max(account.most_frames for account, _ in depth),
            repeated=before.repeated + now.repeated,
            skipped=before.skipped + now.skipped,
            concealed=before.concealed + now.concealed,
            longest_gap=max(before.longest_gap, now.longest_gap),
        )
