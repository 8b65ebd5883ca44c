"""Kinds of coupling, by `coupling.kind` of the settings, and what all that reads settings needs to know of each.

What each end makes of a kind is in its own table: `cogrip.client.schemes` and `cogrip.server.schemes`.
"""

from typing import NamedTuple

from cogrip.protocol.passivity_control import LENT_J
from cogrip.protocol.setting_types import Kind


class CouplingKind(NamedTuple):
    """Properties of a kind. None has a default: whoever adds a kind decides each.

    waves    both ends send `Waves`: then a scene may have poses and has an energy limiter, and the line can be tuned live
    local    the client renders contact itself, so that its force does not wait for the line
    passive  creates no energy, given the passive server step and a decimator that creates none
    lent_j   energy that each direction may lend before any has come [J]; None: the line's credit, `playout.tank_mj`
    """

    waves: bool
    local: bool
    passive: bool
    lent_j: float | None

    @property
    def felt_through_waves(self) -> bool:
        """True where contact is felt through wave lines: they make it softer, and compensation makes up for that."""
        return self.waves and not self.local


COUPLING_KINDS: dict[Kind, CouplingKind] = {
    "wave": CouplingKind(waves=True, local=False, passive=True, lent_j=None),
    "local": CouplingKind(waves=True, local=True, passive=True, lent_j=None),
    "coupling": CouplingKind(waves=False, local=False, passive=False, lent_j=0.0),  # no line that could lend anything
    "tdpa": CouplingKind(waves=False, local=False, passive=True, lent_j=LENT_J),
}


def lent_mj(kind: Kind, tank_mj: float) -> float:
    """Return the energy that each direction of a line may lend [mJ]: the credit of a wave line, E(0) of passivity control."""
    lent_j = COUPLING_KINDS[kind].lent_j
    return tank_mj if lent_j is None else lent_j * 1e3
