"""The books of the lines that a person had before the present one: a server that was started anew begins a new line."""

import msgspec

from cogrip.client.coupling import Coupling
from cogrip.protocol.accounts import LinkCount


class PastLines:
    """Sums over closed couplings; each question adds the coupling that is in use. Energies in J."""

    def __init__(self) -> None:
        self._port_j = 0.0
        self._lost = 0
        self._count = LinkCount()
        self._margin_j: float | None = None

    def close(self, coupling: Coupling) -> None:
        """This line is over. What it had heard of but not played is never played now."""
        self._port_j = self.port_j(coupling)
        self._margin_j = self.down_margin_j(coupling)
        self._lost = self.lost(coupling)
        self._count = msgspec.structs.replace(self.count(coupling), pending=0)

    def port_j(self, coupling: Coupling) -> float:
        """Energy that went into all lines."""
        return self._port_j + coupling.port_j

    def down_margin_j(self, coupling: Coupling) -> float | None:
        """The least of all lines, None where there are no waves."""
        now = coupling.down_margin_j
        return now if self._margin_j is None or now is None else min(self._margin_j, now)

    def lost(self, coupling: Coupling) -> int:
        """Frames from the server."""
        return self._lost + coupling.lost()

    def count(self, coupling: Coupling) -> LinkCount:
        before, now = self._count, coupling.count()
        sums = {name: getattr(before, name) + getattr(now, name) for name in LinkCount.__struct_fields__}
        return LinkCount(**sums)
