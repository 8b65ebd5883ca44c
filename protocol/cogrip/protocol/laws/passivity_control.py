"""Constants of time-domain passivity control that both ends share (`SPEC.md` section 7b). Energies in J."""

LENT_J = 1e-4  # E(0) of each direction, over all axes: energy that it may lend before any has come (P eq. 1)
CHARGE_UP_J = 1e-2  # energy of each axis that the server should have to take: while it has less, the client enters more
CHARGE_DOWN_J = 2e-3
"""Energy of each axis that the client should have to take: while it has less, the server enters more."""
