"""The books of the lines that a person had before the present one: a server that was started anew begins a new line."""

import msgspec

from cogrip.client.coupling import Coupling
from cogrip.protocol.accounts import LinkCount, PlayoutAccount


class PastLines:
    """Sums over closed couplings; each question adds the coupling that is in use. Energies in J."""

    def __init__(self) -> None:
        self.port_j = 0.0  # energy that went into the closed ones
        self._lost = 0
        self._count = LinkCount()
        self._playout: PlayoutAccount | None = None
        self.least_j: float | None = None  # margin down
        self._reserve_j: float | None = None

    def close(self, coupling: Coupling) -> None:
        """This line is over. What it had heard of but not played is never played now."""
        self.port_j += coupling.port_j
        self.least_j = coupling.down_margin_j
        self._reserve_j = self.down_reserve_j(coupling)
        self._lost = self.lost(coupling)
        self._playout = self.playout_account(coupling)
        self._count = msgspec.structs.replace(self.count(coupling), pending=0)

    def down_reserve_j(self, coupling: Coupling) -> float | None:
        """The least after the first second of each line, None where no line was that long."""
        told = [each for each in (self._reserve_j, coupling.down_reserve.reported_j) if each is not None]
        return min(told, default=None)

    def lost(self, coupling: Coupling) -> int:
        """Frames from the server."""
        return self._lost + coupling.lost()

    def account(self, coupling: Coupling) -> tuple[LinkCount, PlayoutAccount | None, float | None]:
        """Frames that came down, how they were played out, and the least reserve."""
        return self.count(coupling), self.playout_account(coupling), self.down_reserve_j(coupling)

    def count(self, coupling: Coupling) -> LinkCount:
        before, now = self._count, coupling.count()
        sums = {name: getattr(before, name) + getattr(now, name) for name in LinkCount.__struct_fields__}
        return LinkCount(**sums)

    def playout_account(self, coupling: Coupling) -> PlayoutAccount | None:
        """The mean depth is that of all frames sent; a line that never began says nothing of depths. None without waves."""
        before, now = self._playout, coupling.playout_account()
        if before is None or now is None:
            return now
        frames, more = self._count.sent, coupling.count().sent
        depth = [(account, sent) for account, sent in ((before, frames), (now, more)) if sent] or [(before, 1)]
        return PlayoutAccount(
            depth_frames=sum(account.depth_frames * sent for account, sent in depth) / sum(sent for _, sent in depth),
            least_frames=min(account.least_frames for account, _ in depth),
            most_frames=max(account.most_frames for account, _ in depth),
            repeated=before.repeated + now.repeated,
            skipped=before.skipped + now.skipped,
            concealed=before.concealed + now.concealed,
            longest_gap=max(before.longest_gap, now.longest_gap),
        )
