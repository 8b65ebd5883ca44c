"""Fingerprint of the settings that both ends of a session must agree on."""

import hashlib
from pathlib import Path

import msgspec

from cogrip.protocol.settings.room import coupling_asked, rates_of
from cogrip.protocol.settings.sections import Settings


def digest(settings: Settings) -> str:
    """Return a fingerprint of everything the ends must agree on (not: hand, duration, emulated link)."""
    users = [
        (user.name, user.side, coupling_asked(settings, user), rates_of(settings, user).device_hz)
        for user in settings.users
    ]
    shared = [settings.rates.network_hz, settings.object.shared(settings.object.axes), settings.playout, users]
    if settings.object.traits.scene:  # a path differs from machine to machine
        shared += [
            _scene(Path(settings.object.file)),
            settings.object.substeps,
            [(user.tool, user.orientation) for user in settings.users],
            *([begins] if any(begins := (settings.object.keyframe, settings.object.ctrl)) else []),
        ]
    return hashlib.sha256(msgspec.json.encode(shared, order="deterministic")).hexdigest()[:16]


def _scene(file: Path) -> str:
    """Return a digest of a scene's text; its name where it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError:
        return file.name
