"""Settings of a file or name (TOML, or the JSON that a run folder keeps), with `--set`, `--hands` and `--device`."""

import difflib
import json
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from cogrip.cli.settings.settings_origin import Origin
from cogrip.cli.settings.shipped_settings import (
    SUFFIX,
    is_name,
    no_such_settings,
    shipped,
    shipped_names,
    shipped_scene,
)
from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import BadInput
from cogrip.devices.device import DeviceError
from cogrip.devices.for_user import try_for
from cogrip.devices.registry import is_real
from cogrip.protocol.settings.network_rate import asks_auto
from cogrip.protocol.settings.object_kinds import KINDS, PYTHON, split_python
from cogrip.protocol.settings.room import rates_of, resolve, seat_axes, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError, parse_override

NESTED = "is nested too deep for settings, which have three levels; take the brackets out"
TRACES = ("link.trace", "link.up.trace", "link.down.trace")
GIVE = "give a settings file, or a name of `cogrip configs`, such as demo"


Overrides = Sequence[str] | Mapping[str, Any]
"""Overrides: `--set` as typed, or values by dotted key."""


def load(
    path: Path, overrides: Overrides = (), *, world: bool = True, rate: Callable[[Settings], int] | None = None,
    flags: Mapping[str, str] = {},
) -> Settings:  # fmt: skip
    """Return the settings of a file, or of a bare name such as `demo` those that come with cogrip (docs/commands.md).

    A file of exactly that name comes first; a folder does not count. world: try the world as well, which may run another
    author's program; only who steps it does that. rate: of the network, where they ask for "auto". flags: key -> flag, of
    overrides that another flag than `--set` gave. Raises BadInput, which names the flag or the file that an error comes from.
    """
    text = ""
    try:
        file = _file_of(path)
        _refuse_endless(file)
        text = file.read_text(encoding="utf-8")
        table = json.loads(text) if file.suffix == ".json" else tomllib.loads(text)
    except FileNotFoundError:
        raise BadInput(f"{path}: there is no such file; {_cure(path)}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except tomllib.TOMLDecodeError as error:
        words, _, place = str(error).partition(" (at ")
        found = re.fullmatch(r"line (\d+), column (\d+)\)", place)
        line, column = found.groups() if found else (text.count("\n") + 1, "")
        raise BadInput(_not_valid(path, "TOML", words, line, column)) from None
    except json.JSONDecodeError as error:
        raise BadInput(_not_valid(path, "JSON", error.msg, error.lineno, error.colno)) from None
    except RecursionError:
        raise BadInput(f"{path}: {NESTED}") from None
    if not isinstance(table, dict):
        raise BadInput(f"{path}: holds no table of settings; {GIVE}")
    place_files(table, file.parent)
    origin = _origin(overrides, f"{path}: ", flags)
    settings = _resolved(table, origin)
    if world:
        _try_world(settings, origin.before("object.kind"))
    if rate is not None and asks_auto(table, origin.given):
        settings = _resolved(table, replace(origin, given={**origin.given, "rates.network_hz": rate(settings)}))
    return settings


def _file_of(path: Path) -> Path:
    """Return the file of that name, else for a bare name the one that comes with cogrip."""
    if not is_name(path) or path.is_file() or path.name not in shipped_names():
        return path
    file, here = shipped(path.name), path.with_suffix(SUFFIX)
    if here.is_file() and not here.samefile(file):
        errors = make_console(stderr=True, soft_wrap=True)
        errors.print(f"note: {path} is the one that comes with cogrip; write {here} for the file in this folder")
    return file


def _refuse_endless(file: Path) -> None:
    """Raise BadInput for a pipe or device by its name, which may never end; one that a shell opened (`<(...)`) is allowed."""
    if file.exists() and not (file.is_file() or file.is_dir() or str(file).startswith(("/dev/stdin", "/dev/fd/"))):
        raise BadInput(f"{file}: is no regular file; {GIVE}")


def _cure(path: Path) -> str:
    """Return what to give in place of a file that does not exist."""
    if is_name(path):
        return no_such_settings(path.name)
    ours = {str(path.with_name(f"{name}{SUFFIX}")): f"{name}, which comes with cogrip" for name in shipped_names()}
    known = ours | {str(found): str(found) for found in path.parent.glob(f"*{SUFFIX}")}
    if close := difflib.get_close_matches(str(path), known, n=1):
        return f"did you mean {known[close[0]]}?"
    return "give the path of a settings file, or a name of `cogrip configs`"


def _not_valid(path: Path, form: str, words: str, line: object, column: object) -> str:
    place = f"column {column}" if column else "the end of the file"
    return f"{path}:{line}: not valid {form}, at {place}: {words[:1].lower()}{words[1:]}"


def from_flags(overrides: Sequence[str], flags: Mapping[str, str] = {}) -> Settings:
    """Return the settings of flags alone: of `--set`, or as `flags` has it by key. Raises BadInput."""
    return _resolved({}, _origin(overrides, "", flags))


def from_table(table: dict[str, Any], overrides: Overrides = ()) -> Settings:
    """Return the settings of a table; paths in it are relative to the current folder. Raises BadInput."""
    place_files(table, Path())
    origin = _origin(overrides, "", {})
    settings = _resolved(table, origin)
    _try_world(settings, origin.before("object.kind"))
    return settings


def _origin(overrides: Overrides, file: str, flags: Mapping[str, str]) -> Origin:
    if isinstance(overrides, Mapping):
        return Origin(file, _overrides(overrides), typed=False)
    times = Counter(
        text.partition("=")[0].strip() for text in overrides
    )  # where a `--set` gives it, too, that is meant
    flags = {key: flag for key, flag in flags.items() if times[key] == 1}
    return Origin(file, _overrides(overrides), flags=flags)


def _resolved(table: dict[str, Any], origin: Origin) -> Settings:
    """Return the settings of a table with the flags' values, whose traces and scene can be read. Raises BadInput."""
    try:
        settings = resolve(table, origin.given)
    except RecursionError:
        raise BadInput(f"{origin.file}{NESTED}") from None
    except SettingsError as error:
        raise BadInput(origin.explained(table, error)) from None
    _try_traces(settings, origin.before(*TRACES))
    _try_scene(settings, origin.before("object.file"))
    return settings


def _overrides(overrides: Overrides) -> dict[str, Any]:
    """Return them by key. A file's path in them is relative to the current folder. Raises BadInput."""
    found = dict(overrides if isinstance(overrides, Mapping) else map(override, overrides))
    for key, value in found.items():
        if key in (*TRACES, "object.folder") and isinstance(value, str) and value:
            found[key] = str(Path(value).absolute())
        if key == "object.file" and isinstance(value, str) and value:
            found[key] = _scene_at(Path(), value)
        if key in ("object.kind", "object.script") and isinstance(value, str):
            found[key] = _kind_at(Path(), value)
    return found


def place_files(table: dict[str, Any], folder: Path) -> None:
    """Make the paths of files that settings name, which are relative to `folder`, absolute."""
    _place_traces(table, folder)
    _place_scene(table, folder)


def _place_traces(table: dict[str, Any], folder: Path) -> None:
    """Make the paths of traces, which are relative to the settings file, absolute."""
    link = table.get("link")
    sections = [link, *(link.get(direction) for direction in ("up", "down"))] if isinstance(link, dict) else []
    for section in sections:
        if isinstance(section, dict) and isinstance(section.get("trace"), str) and section["trace"]:
            section["trace"] = str((folder / section["trace"]).absolute())


def _place_scene(table: dict[str, Any], folder: Path) -> None:
    """Make the path of a scene or a world, which is relative to the settings file, absolute."""
    section = table.get("object")
    if isinstance(section, dict) and isinstance(section.get("kind"), str):
        section["kind"] = _kind_at(folder, section["kind"])
    if isinstance(section, dict) and isinstance(section.get("script"), str):
        section["script"] = _kind_at(folder, section["script"])
    if isinstance(section, dict) and isinstance(section.get("file"), str) and section["file"]:
        section["file"] = _scene_at(folder, section["file"])
    if isinstance(section, dict) and isinstance(section.get("folder"), str) and section["folder"]:
        section["folder"] = str((folder / section["folder"]).absolute())


def _scene_at(folder: Path, name: str) -> str:
    """Return the absolute path of a scene: in `folder`, else the one of that name that comes with cogrip."""
    here, ours = (folder / name).absolute(), shipped_scene(name)
    return str(ours if ours.is_file() and not here.exists() else here)


def _kind_at(folder: Path, kind: str) -> str:
    """Return a kind of object; where it is a class in a file, with the file's absolute path."""
    file, class_name = split_python(kind)
    return f"{PYTHON}{(folder / file).absolute()}:{class_name}" if kind.startswith(PYTHON) and file else kind


def _try_world(settings: Settings, where: str) -> None:
    """Raise BadInput for a world or a scene's script that cannot be had, before anything is started."""
    if settings.object.script:
        from cogrip.server.worlds.registry import WorldKindError
        from cogrip.server.worlds.scenes.scene_script import script_of
        from cogrip.server.worlds.world import WorldError

        with BadInput.of(WorldKindError, WorldError, where=where):
            script_of(settings.object.script)
    if settings.object.kind not in KINDS:
        from cogrip.server.worlds.registry import WorldKindError, make_guarded
        from cogrip.server.worlds.world import WorldError

        with BadInput.of(WorldKindError, WorldError, where=where):
            make_guarded(settings.object.kind, [seat_settings(settings, seat) for seat in range(len(settings.users))])


def _try_scene(settings: Settings, where: str) -> None:
    """Raise BadInput for a scene that cannot be used, before anything is started."""
    if settings.object.traits.scene:
        from cogrip.server.schemes import make_scene_world
        from cogrip.server.worlds.scenes.scene_text import SceneError

        alone = msgspec.structs.replace(
            settings, object=msgspec.structs.replace(settings.object, script="")
        )  # a client runs no program
        with BadInput.of(SceneError, where=f"{where}object.file: "):
            make_scene_world(alone, [seat_settings(settings, seat) for seat in range(len(settings.users))])


def _try_traces(settings: Settings, where: str) -> None:
    """Raise BadInput for a trace that cannot be read, before anything is started."""
    traces = {settings.link.trace_of(direction) for direction in ("up", "down")} - {""}
    if traces:
        from cogrip.sim.delay_trace import TraceError, read_trace

        with BadInput.of(TraceError, where=f"{where}link.trace: "):
            for trace in sorted(traces):
                read_trace(Path(trace))


def try_session(settings: Settings, where: str) -> None:
    """Raise BadInput for a trace, scene, world, device or hand that cannot be had, before anything is left behind."""
    _try_traces(settings, where)
    _try_scene(settings, where)
    _try_world(settings, where)
    try_hands(settings, where)


def try_hands(settings: Settings, where: str = "") -> None:
    """Raise BadInput for a device or hand that is not available, before anything is started or left behind."""
    for user in settings.users:
        with BadInput.of(DeviceError, where=f"{where}{user.name}: "):
            try_for(user, seat_axes(settings, user), rates_of(settings, user).device_hz)


def refuse_real(settings: Settings) -> None:
    """Raise BadInput for hardware, which cannot run in virtual time; nothing is opened."""
    for user in settings.users:
        with BadInput.of(DeviceError, where=f"{user.name}: "):
            real = is_real(user.device)
        if real:
            raise BadInput(
                f"{user.name}: {user.device}: is hardware, and virtual time would not wait for it: take emulated: (such as"
                " emulated:vintage) or sim:, or hold it live with `cogrip demo` or `cogrip join`"
            )


def with_people(settings: Settings, hands: Sequence[str], devices: Sequence[str]) -> Settings:
    """Return `settings` with the first, second ... person's hand or device replaced. Raises BadInput for too many."""
    users = list(settings.users)
    for flag, key, values in (("--hands", "hand", hands), ("--device", "device", devices)):
        if len(values) > len(users):
            raise BadInput(f"{flag} is given {len(values)} times, but {settings.name} has {len(users)} users")
        for number, value in enumerate(values):
            users[number] = msgspec.structs.replace(users[number], **{key: value})
    return msgspec.structs.replace(settings, users=tuple(users))


def override(text: str) -> tuple[str, Any]:
    """Return key and value of a `--set`, the value read as TOML; a bare word is text. Raises BadInput."""
    with BadInput.of(SettingsError):
        key, value = parse_override(text)
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value
    except RecursionError:
        raise BadInput(f"--set {key}: the value {NESTED}") from None
