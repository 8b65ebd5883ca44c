"""Constants of time-domain passivity control that both ends share (`SPEC.md` section 7b). Energies in J."""

from cogrip.protocol.coupling_settings import CouplingBase
from cogrip.protocol.settings import Playout

LENT_J = 1e-4  # E(0) of each direction, over all axes: energy that it may lend before any has come (P eq. 1)
CHARGE_UP_J = 1e-2  # on each axis: while the server has less than this to take, the client enters more
CHARGE_DOWN_J = 2e-3  # likewise in the other direction


def lent_mj(coupling: CouplingBase, playout: Playout) -> float:
    """Return the energy that each direction of a line may lend [mJ]: the credit of a wave line, E(0) of passivity control.

    Virtual coupling has no line that could lend anything.
    """
    return {"tdpa": LENT_J * 1e3, "coupling": 0.0}.get(coupling.kind, playout.tank_mj)
