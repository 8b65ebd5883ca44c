"""Reading a settings file (TOML, or the JSON that a run folder keeps) with its `--set` overrides."""

import difflib
import json
import tomllib
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec

from cogrip.cli.problem import BadInput
from cogrip.devices.device import DeviceError
from cogrip.devices.for_user import try_for
from cogrip.devices.registry import is_real
from cogrip.protocol.settings import Settings, resolve
from cogrip.protocol.settings_table import SettingsError, parse_override


def load(path: Path, overrides: Sequence[str] = ()) -> Settings:
    """Raises BadInput, naming the file, for anything wrong in it."""
    try:
        text = path.read_text(encoding="utf-8")
        table = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except FileNotFoundError:
        near = [str(found) for found in path.parent.glob("*.toml")] if path.parent.is_dir() else []
        close = difflib.get_close_matches(str(path), near, n=1)
        cure = f"did you mean {close[0]}?" if close else "give the path of a settings file, such as configs/demo.toml"
        raise BadInput(f"{path}: there is no such file; {cure}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        raise BadInput(f"{path}: not valid {path.suffix.removeprefix('.').upper() or 'TOML'}: {error}") from None
    try:
        return resolve(table, dict(override(text) for text in overrides))
    except SettingsError as error:
        raise BadInput(f"{path}: {error}") from None


def try_hands(settings: Settings) -> None:
    """Raises BadInput for a device or hand that cannot be had, before anything is started or left behind."""
    for user in settings.users:
        try:
            try_for(user, settings.object.axes, settings.rates.device_hz)
        except DeviceError as error:
            raise BadInput(f"{user.name}: {error}") from None


def refuse_real(settings: Settings) -> None:
    """Raises BadInput for a device of hardware, which no virtual time can hold; nothing is opened."""
    for user in settings.users:
        try:
            real = is_real(user.device)
        except DeviceError as error:
            raise BadInput(f"{user.name}: {error}") from None
        if real:
            raise BadInput(
                f"{user.name}: {user.device}: is hardware, and virtual time would not wait for it: take emulated: (such as"
                " emulated:vintage) or sim:, or hold it live with `cogrip demo` or `cogrip join`"
            )


def with_people(settings: Settings, hands: Sequence[str], devices: Sequence[str]) -> Settings:
    """`settings` with the first, second ... person's hand or device replaced. Raises BadInput for too many."""
    users = list(settings.users)
    for flag, key, values in (("--hands", "hand", hands), ("--device", "device", devices)):
        if len(values) > len(users):
            raise BadInput(f"{flag} is given {len(values)} times, but {settings.name} has {len(users)} users")
        for number, value in enumerate(values):
            users[number] = msgspec.structs.replace(users[number], **{key: value})
    return msgspec.structs.replace(settings, users=tuple(users))


def shipped(name: str) -> Path:
    """The settings file `name` of those that come with cogrip: from the checkout, or from the installed package."""
    checkout = Path(__file__).resolve().parents[3] / "configs" / name
    return checkout if checkout.exists() else Path(str(files("cogrip.cli") / "configs" / name))


def override(text: str) -> tuple[str, Any]:
    """Key and value of a `--set`, the value read as TOML; a bare word is text. Raises BadInput."""
    try:
        key, value = parse_override(text)
    except SettingsError as error:
        raise BadInput(str(error)) from None
    try:
        return key, tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key, value
