"""Networks by name: the values that `link.profile` puts into [link]. Where each number comes from is in docs/networks.md.

lan        two machines on one switch
wifi       the last hop of a busy campus: jitter in the order of a frame, losses in bursts, a channel scan every two minutes
wan        coast to coast over the public Internet, with ordinary lines at both ends
lte        one end on a mobile network, at rest
satellite  one end behind a geostationary satellite
"""

from collections.abc import Mapping
from typing import Literal, NamedTuple

ProfileName = Literal["lan", "wifi", "wan", "lte", "satellite"]


class Profile(NamedTuple):
    """Values by the names of [link]. both: of both directions; up (client to server) and down override it."""

    both: Mapping[str, float]
    up: Mapping[str, float] = {}
    down: Mapping[str, float] = {}

    def direction(self, direction: Literal["up", "down"]) -> dict[str, float]:
        """Return the values of one direction."""
        return {**self.both, **(self.up if direction == "up" else self.down)}


PROFILES: dict[ProfileName, Profile] = {
    "lan": Profile({"delay_ms": 0.1, "jitter_ms": 0.05}),
    "wifi": Profile({
        "delay_ms": 2.0, "jitter_ms": 8.0, "loss": 0.01, "burst_frames": 5.0, "outage_s": 0.1, "outage_every_s": 120.0,
    }),
    "wan": Profile({"delay_ms": 40.0, "jitter_ms": 4.0, "loss": 0.004, "burst_frames": 2.0}),
    "lte": Profile(
        {"loss": 0.001, "burst_frames": 5.0},
        up={"delay_ms": 25.0, "jitter_ms": 6.0},
        down={"delay_ms": 15.0, "jitter_ms": 3.0},
    ),
    "satellite": Profile(
        {"delay_ms": 285.0, "loss": 0.01},
        up={"jitter_ms": 20.0, "rate_kbps": 2000.0},
        down={"jitter_ms": 10.0, "rate_kbps": 20_000.0},
    ),
}  # fmt: skip
