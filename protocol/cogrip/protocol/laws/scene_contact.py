"""Contact of scenes, alike at the server and in a client's own copy (theory 8.2); names and values are MJCF's.

solimp = d d w .5 2      solref = -kappa (1 - d), -beta (1 - d)
"""

from typing import Any

CONTACT_SHARE = 0.1  # d of a contact (solimp)
CONTACT_RATE_PS2, CONTACT_DAMPING_PS = 4e5, 1300.0  # kappa and beta of a contact: stiffness and damping by mass
GEOM: dict[str, Any] = {
    "margin": 0.005,
    "condim": 4,
    "solimp": (CONTACT_SHARE, CONTACT_SHARE, 0.001, 0.5, 2.0),
    "solref": (-CONTACT_RATE_PS2 * (1.0 - CONTACT_SHARE), -CONTACT_DAMPING_PS * (1.0 - CONTACT_SHARE)),
}
"""Attributes of a geom."""
HOLD_RATE_PS2, HOLD_DAMPING_PS = 4.0 * CONTACT_RATE_PS2, 2.0 * CONTACT_DAMPING_PS
"""Kappa and beta of a weld, which is to store little."""
WELD: dict[str, Any] = {
    "solimp": GEOM["solimp"],
    "solref": (-HOLD_RATE_PS2 * (1.0 - CONTACT_SHARE), -HOLD_DAMPING_PS * (1.0 - CONTACT_SHARE)),
}
"""Attributes of a weld, and of other equalities."""
IMPRATIO = 3000.0
