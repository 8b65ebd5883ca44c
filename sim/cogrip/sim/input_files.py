"""The files that a session reads besides its settings: recorded delay traces, recorded hands, scenes, and worlds.

Settings only name them; their digests are part of an experiment's query.
"""

import hashlib
from pathlib import Path

from cogrip.devices.device import DeviceError
from cogrip.devices.for_user import address_of
from cogrip.devices.settings import parse_address
from cogrip.devices.simulated.recorded_motion import find, split_user
from cogrip.protocol.settings.object_kinds import PYTHON, split_python
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.scene_text import SceneError, read_scene

UNREADABLE = "unreadable"  # digest of a file that cannot be read: whoever runs the session says what is wrong with it


def files_read(settings: Settings) -> dict[str, str]:
    """Return the SHA-256 of each file's content, by its path as in the settings."""
    kind = settings.object.kind
    world = split_python(kind)[0] if kind.startswith(PYTHON) else ""
    script = split_python(settings.object.script)[0] if settings.object.script else ""
    paths = {settings.link.trace_of(direction) for direction in ("up", "down")} | {settings.object.file, world, script}
    paths -= {""}
    found = {path: _digest(Path(path)) for path in paths}
    if settings.object.file:
        found[settings.object.file] = _scene(Path(settings.object.file), settings.object.folder)
    for user in settings.users:
        found |= _recorded(address_of(user))
    return found


def _scene(path: Path, folder: str) -> str:
    """Return the digest of a scene: of its text, and where it names files of all of them."""
    try:
        scene = read_scene(path, Path(folder) if folder else None)
    except SceneError:
        return _digest(path)
    return _digest(path) if len(scene.files) == 1 else scene.root.strip("/")


def _recorded(address: str) -> dict[str, str]:
    """Return the digests of the files of the device at this address, or of the hand in it."""
    try:
        parsed = parse_address(address)
    except DeviceError:
        return {}
    kind, _, name = parsed.query.get("hand", "").partition(":")
    if kind == "csv":
        return {name: _digest(Path(name))}
    if kind == "recording":
        return _run(*split_user(name))
    if parsed.scheme != "replay":
        return {}
    if parsed.name.endswith(".csv"):
        return {parsed.name: _digest(Path(parsed.name))}
    return _run(parsed.name, parsed.query.get("user", "0"))


def _run(path: str, user: str) -> dict[str, str]:
    """Return the digest of one person's recording in a run."""
    try:
        return {f"{path}#user={user}": _digest(find(path, user).path)}
    except DeviceError:
        return {f"{path}#user={user}": UNREADABLE}


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return UNREADABLE
