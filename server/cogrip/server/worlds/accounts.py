"""Accounts of a world, beside it: what a run tells of it. No step depends on them."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cogrip.machine.rows import Row

Contact = tuple[float | None, float | None, float | None]
"""Normal force and friction at a person's tool [N], and its slip [m]; None where there are no bodies."""
NO_CONTACT: Contact = (None, None, None)


class Springs(Protocol):
    """A world with the stiffness of each person's spring [N/m], shape (n, 1)."""

    stiffness: NDArray[np.float64]


class Accounts:
    """Those of a world whose step makes no energy, with a spring for each person."""

    def __init__(self, world: Springs) -> None:
        self._world = world

    def limiter(self) -> dict[str, float] | None:
        """Return the ledger of what bounds the energy that goes back; None where the step itself makes none."""
        return None

    def scene(self) -> dict[str, Any] | None:
        """Return contact forces, slip and lift of the run so far (docs/summary.md); None where there are no bodies."""
        return None

    def contact(self, user: int) -> Contact:
        """Return what a person's tool feels of bodies."""
        return NO_CONTACT

    def stiffness(self, user: int) -> float | None:
        """Return K of a user's spring now [N/m]; None where there is no spring."""
        return float(self._world.stiffness[user, 0])

    def sensor_names(self) -> Sequence[str]:
        """Return a name for each number of `sensors`; none where a world has no sensors of its own."""
        return ()

    def sensors(self) -> Row:
        """Return the values of the world's own sensors after the last step."""
        return ()


class ToolAccounts(Accounts):
    """Those of a world in which each person moves a tool: no spring stands between the two."""

    def stiffness(self, user: int) -> float | None:
        return None
