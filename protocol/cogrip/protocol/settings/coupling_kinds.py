"""Kinds of coupling, by `coupling.kind` of the settings, and what all that reads settings needs to know of each.

What each end makes of a kind is in its own table: `cogrip.client.coupling.schemes` and `cogrip.server.schemes`.
"""

from typing import NamedTuple

from cogrip.protocol.settings.types import Kind


class CouplingKind(NamedTuple):
    """Properties of a kind. None has a default: whoever adds a kind decides each.

    waves    both ends send `Waves`: then a scene may have poses and has an energy limiter, and the line can be tuned live
    local    the client renders contact itself, so that its force does not wait for the line
    passive  creates no energy, given the passive server step and a decimator that creates none
    """

    waves: bool
    local: bool
    passive: bool

    @property
    def felt_through_waves(self) -> bool:
        """True where contact is felt through wave lines: they make it softer, and compensation makes up for that."""
        return self.waves and not self.local


COUPLING_KINDS: dict[Kind, CouplingKind] = {
    "wave": CouplingKind(waves=True, local=False, passive=True),
    "local": CouplingKind(waves=True, local=True, passive=True),
    "coupling": CouplingKind(waves=False, local=False, passive=False),
    "tdpa": CouplingKind(waves=False, local=False, passive=True),
}

UNLENT_MJ = 1.0
"""Energy that a scheme without a credit may give out before it is not passive [mJ]: it moves an arm of 75 g at 0.16 m/s."""


def lent_mj(kind: Kind, tank_mj: float) -> float:
    """Return what each direction of a line may give out beyond what came in [mJ]: the credit of a wave line, else UNLENT_MJ."""
    return tank_mj if COUPLING_KINDS[kind].waves else min(tank_mj, UNLENT_MJ)
