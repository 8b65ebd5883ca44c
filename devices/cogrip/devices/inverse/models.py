"""Record of the Inverse3, and where its service listens."""

from dataclasses import replace

from cogrip.devices.device import Capability, encoder_record
from cogrip.devices.inverse.messages import BUTTONS
from cogrip.machine.rows import Vector

DEFAULT = ("localhost", 10001)  # host and port of the service's simulation channel
HALF_M = (0.07, 0.11, 0.08)
RECORD: Capability = replace(
    encoder_record(
        "inverse", "inverse3", tuple((-half, half) for half in HALF_M), (4.0, 1.5), (600.0, 4.0), (5e-5, 0.15),
        rate_hz=1024, speed_mps=1.5, latency_ticks=1,
    ),
    buttons=len(BUTTONS), gives_orientation=True,
)  # fmt: skip
"""Nominal throughout: Haply's pages that we could read state none of it. Forces are well below the 10 N that is said of it."""

CENTRE_M: Vector = (0.15, 0.0, 0.16)
"""Middle of the workspace from the base's origin, in our axes: near the cursor positions in the service's own examples."""
