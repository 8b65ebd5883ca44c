"""What both ends of time-domain passivity control agree on (`SPEC.md` section 7b). Energies in J."""

from cogrip.protocol.settings import Coupling, Playout

LENT_J = 1e-4  # E(0) of each direction, over all axes: what it may lend itself before anything has come (P eq. 1)
CHARGE_UP_J = 1e-2  # on each axis: while the server has less to take, the client pays in more
CHARGE_DOWN_J = 2e-3  # likewise the other way


def lent_mj(coupling: Coupling, playout: Playout) -> float:
    """What each direction of a line may lend itself [mJ]: the tank of a line of waves, E(0) of passivity control."""
    return LENT_J * 1e3 if coupling.kind == "tdpa" else playout.tank_mj
