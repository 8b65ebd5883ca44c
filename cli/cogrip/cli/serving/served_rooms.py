"""Rooms of `cogrip serve`: their settings, and the warnings before anyone joins."""

import os
from collections.abc import Callable, Sequence
from ipaddress import ip_address
from pathlib import Path
from typing import Literal

import msgspec

from cogrip.cli.session.network_rate import RateChoices
from cogrip.cli.settings.before_run import scene_notes, scene_warnings, together
from cogrip.cli.settings.settings_file import load
from cogrip.cli.terminal.problem import BadInput, within
from cogrip.devices.device import DeviceError
from cogrip.machine.platform import system
from cogrip.protocol.settings.room import not_passive
from cogrip.protocol.settings.sections import Settings
from cogrip.server.events import ServerEvent

MOST_WORKERS = 256
MOST_SPARE = 1000  # most spare rooms of a template
Workers = int | Literal["auto"]
Say = Callable[[ServerEvent | str], None]


def worker_count(wanted: Workers, rooms: int) -> int:
    """Return the number of workers: no more than there are rooms; "auto": one less than there are cores. Raises BadInput."""
    if wanted != "auto" and not 1 <= wanted <= MOST_WORKERS:
        raise BadInput(f"--workers {wanted}: give a number from 1 to {MOST_WORKERS}, or auto")
    count = min(rooms, max(1, (os.cpu_count() or 1) - 1) if wanted == "auto" else wanted)
    if count > 1 and not system.LINUX:
        if wanted != "auto":
            raise BadInput(
                f"--workers {wanted}: several workers need Linux, whose kernel steers datagrams; leave it out"
            )
        return 1
    return count


def spare_rooms(templates: Sequence[str], overrides: Sequence[str], rates: RateChoices) -> dict[str, list[Settings]]:
    """Return the spare rooms of each `--template FILE:COUNT`, by the template's name. Raises BadInput."""
    found: dict[str, list[Settings]] = {}
    for text in templates:
        file, colon, number = text.rpartition(":")
        if not colon or not number.isdigit() or not 1 <= int(number) <= MOST_SPARE:
            raise BadInput(f"--template {text}: write FILE:COUNT, with a count from 1 to {MOST_SPARE}")
        made = load(Path(file), overrides, rate=rates)
        if made.name in found:
            raise BadInput(
                f"--template {text}: two templates are called {made.name!r}; give each file a `name` of its own"
            )
        try:
            found[made.name] = [
                msgspec.convert({**msgspec.to_builtins(made), "name": f"{made.name}.{place}"}, Settings)
                for place in range(1, int(number) + 1)
            ]
        except msgspec.ValidationError:
            raise BadInput(f"--template {text}: the name {made.name!r} is too long for a number behind it") from None
    return found


def rooms_of(
    config: Sequence[Path], overrides: Sequence[str], port: int, into: Path | None, rates: RateChoices, templates: bool
) -> list[Settings]:
    """Return the settings of each room. templates: whether there are rooms on demand beside them. Raises BadInput."""
    if not config and not templates:
        raise BadInput(
            "serve: name at least one settings file, or one that comes with cogrip (`cogrip configs`), such as demo"
        )
    within("--port", port, 0, 65535)
    rooms = [load(path, overrides, rate=rates) for path in config]
    for path, room in zip(config, rooms, strict=True):
        if kept := room.link.kept_back:
            raise BadInput(
                f"{path}: {kept[0]}: no welcome carries it, so that no client would emulate it: put `cogrip relay` with "
                "this file between, and leave [link] out of the one that is served; `cogrip lab` takes it as it is"
            )
    names = [room.name for room in rooms]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"serve: two rooms are called {name!r}; give each file a `name` of its own")
    if into is not None and len(rooms) > 1:
        raise BadInput("serve: --into takes one room; leave it out to get a folder")
    return rooms


def warn_of(rooms: Sequence[Settings], bound: tuple[str, int], encrypted: bool, say: Say) -> dict[str, list[str]]:
    """Warn of what is dangerous, unstable or not bounded, before anyone joins. Return what was said of each room."""
    reachable = not ip_address(bound[0].partition("%")[0]).is_loopback
    if not encrypted and reachable:
        say(
            f"warning: {bound[0]} is open to everyone who can reach it, and sessions are not encrypted (--insecure): "
            "anyone may join, listen, and forge what moves a motor"
        )
    advised: dict[bytes, tuple[str, ...]] = {}  # by all settings but the name: advice takes some 20 ms
    told: dict[str, list[str]] = {}
    for settings in rooms:
        lines = told[settings.name] = []
        if (encrypted or reachable) and (active := not_passive(settings)):
            lines.append(
                f"warning: room {settings.name} is not passive ({active}): it can make energy, and throw about what people "
                "hold; serve people you trust, or leave these settings out"
            )
        if encrypted and not settings.coupling.traits.passive:
            lines.append(
                f"warning: room {settings.name}: virtual coupling bounds speeds but no power: "
                "serve people you trust, or waves"
            )
        key = msgspec.json.encode(msgspec.structs.replace(settings, name=rooms[0].name))
        if key not in advised:
            advised[key] = _advice_on(settings)
        people = [user.name for user in settings.users]
        lines += [f"warning: room {settings.name}: {text}" for text in together(advised[key], people)]
        notes = [f"note: room {settings.name}: {text}" for text in scene_notes(settings)]
        for line in (*lines, *notes):
            say(line)
    return told


def _advice_on(settings: Settings) -> tuple[str, ...]:
    """Return where a room is not stable, passive or fit for its devices, in the words of `cogrip advise`."""
    from cogrip.analysis.advice.advice import advise
    from cogrip.analysis.advice.partner_advice import partner_warnings
    from cogrip.analysis.linear.linear_session import ModelError

    try:
        if settings.coupling.traits.gated:
            return tuple(dict.fromkeys((*partner_warnings(settings), *scene_warnings(settings))))
        return scene_warnings(settings) if settings.object.traits.scene else advise(settings).warnings
    except (ModelError, DeviceError) as error:
        return (f"no advice: {error}",)
