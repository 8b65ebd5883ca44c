"""The room of a seed, its people and their hands, as a table of settings.

Each seed is another room: gripped or pushed, on one axis or three, with ideal devices or with those that only tell counts, and
in every fourth room people's devices run at unlike rates. People push and pull with hands of their own, drawn from the seed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from random import Random
from typing import Any

from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings

CLEAN = "clean"
NETWORKS: tuple[str, ...] = tuple(PROFILES)
SCHEMES: Mapping[str, Mapping[str, Any]] = {
    "wave": {},
    "paper": {"server_step": "paper", "decimator": "lowpass", "encoder": "velocity"},
    "coupling": {"kind": "coupling"},
}
KINDS = ("cube", "faces", "cube", "cube")
UNLIKE_HZ = (2048, 1024, 4096, 1024, 3072)


def impaired(network: str, people: int, stiffness_npm: float, seed: int, seconds: float) -> dict[str, Any]:
    """A room of ours. network: a profile's name, or CLEAN."""
    kind, axes = KINDS[seed % 4], 3 if seed // 4 % 2 else 1
    device = "sim:phantom" if seed % 3 == 0 else "sim:ideal"
    random = Random(f"storm {seed}")
    users = [_user(number, kind, axes, device, random) for number in range(people)]
    if seed % 4 == 3:
        for user, device_hz in zip(users, UNLIKE_HZ, strict=False):
            user["device_hz"] = device_hz
    return {
        "name": "storm", "seed": seed, "seconds": seconds, "object": {"kind": kind, "axes": axes},
        "coupling": {"stiffness_npm": stiffness_npm}, "link": _link(network), "playout": {"frames": "auto"}, "users": users,
    }  # fmt: skip


def loose(network: str, people: int, stiffness_npm: float, seed: int, seconds: float, scheme: str) -> dict[str, Any]:
    """A cube that is given a push and hardly held by anybody: what the eigenvalues of theory section 6 are about."""
    hand = "hand_stiffness_npm=1&hand_damping_nspm=0"
    users = [{"name": f"p{number}", "device": "sim:ideal", "hand": f"hold&{hand}"} for number in range(people)]
    amplitude_m = Random(f"loose {seed}").uniform(0.005, 0.02)
    users[seed % people]["hand"] = f"reach&amplitude_m={amplitude_m!r}&stop_s=1&{hand}"
    return {
        "name": "loose", "seed": seed, "seconds": seconds, "link": _link(network), "users": users,
        "coupling": {"stiffness_npm": stiffness_npm, **SCHEMES[scheme]},
    }  # fmt: skip


def settled(table: Mapping[str, Any], overrides: Mapping[str, Any]) -> Settings:
    """Settings of a cell. Raises SettingsError."""
    return resolve(table, overrides)


def _link(network: str) -> dict[str, Any]:
    return {} if network == CLEAN else {"profile": network}


def _user(number: int, kind: str, axes: int, device: str, random: Random) -> dict[str, Any]:
    """Someone who strokes, swings or trembles: from their side where things are pushed, else in any direction."""
    left = number % 2 == 0
    vector = [random.gauss(0.0, 1.0) for _ in range(axes)]
    if kind == "faces":
        vector[0] = abs(vector[0]) if left else -abs(vector[0])
    size = math.hypot(*vector)
    direction = f"direction={','.join(f'{each / size:.3f}' for each in vector)}"
    amplitude = f"amplitude_m={random.uniform(0.01, 0.04):.4f}"
    stroke = f"stroke_s={random.uniform(0.4, 1.2):.3f}&delay_s={random.uniform(0.0, 0.5):.3f}"
    hand = random.choice((
        f"reach&{amplitude}&{stroke}", f"sine&{amplitude}&frequency_hz={random.uniform(0.4, 2.0):.3f}",
        f"tremor&{amplitude}&{stroke}&seed={random.randrange(2**31)}",
    ))  # fmt: skip
    return {"name": f"p{number}", "device": device, "hand": f"{hand}&{direction}", "side": "left" if left else "right"}
