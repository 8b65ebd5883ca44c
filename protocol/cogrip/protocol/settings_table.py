"""Settings as a raw table, before they are a schema's: overrides, unknown keys, and errors that a person can act on.

A table is nested dicts and lists; `users.0.name` is the path of a key in it.
"""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from types import NoneType
from typing import Any, get_args

import msgspec

from cogrip.protocol.setting_errors import expects, plain


class SettingsError(ValueError):
    """A setting is missing, unknown, of the wrong kind, out of bounds, or does not fit another one."""


def parse_override(text: str) -> tuple[str, str]:
    """Split `section.key=value`. Raises SettingsError."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise SettingsError(f"--set {text!r}: write it as section.key=value, for instance coupling.stiffness_npm=500")
    return key.strip(), value.strip()


def copied(value: Any) -> Any:
    """A table that may be changed without touching `value`."""
    if isinstance(value, Mapping):
        return {key: copied(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [copied(item) for item in value]
    return value


def override(table: dict[str, Any], key: str, value: Any, only_user: str) -> None:
    """Set one key by its path. only_user: the name of the user there is where a table names none. Raises SettingsError."""
    *path, last = key.split(".")
    here: Any = table
    for depth, part in enumerate(path):
        if isinstance(here, list):
            here = _item(here, part, key)
        else:
            here = here.setdefault(part, [{"name": only_user}] if part == "users" else {})
        if not isinstance(here, (dict, list)):
            raise SettingsError(f"--set {key}: {'.'.join(path[: depth + 1])} is a value, not a section")
    if isinstance(here, list):
        raise SettingsError(f"--set {key}: name a user's number and key, for instance users.0.stiffness_npm")
    here[last] = value


def _item(items: list[Any], part: str, key: str) -> Any:
    if not part.isdigit() or int(part) >= len(items):
        raise SettingsError(f"--set {key}: there is no user number {part} (users are numbered 0 to {len(items) - 1})")
    return items[int(part)]


def refuse_unknown(
    table: Any, struct: type[msgspec.Struct], where: str = "", root: type[msgspec.Struct] | None = None
) -> None:
    """Raises SettingsError for a key that is no field of `struct`, or of the structs in it. where: the path of `table`."""
    root = root or struct
    if not isinstance(table, dict):
        return
    fields = {field.name: field.type for field in msgspec.structs.fields(struct)}
    for key, value in table.items():
        path = f"{where}{key}"
        if key not in fields:
            near = _nearest(str(key), fields, where, root)
            cure = f"did you mean {near}?" if near else f"known here: {', '.join(fields)}"
            raise SettingsError(f"{path}: there is no such setting; {cure}")
        kind = fields[key]
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            refuse_unknown(value, kind, f"{path}.", root)
        elif isinstance(value, list) and (item_kind := _item_struct(kind)) is not None:
            for index, item in enumerate(value):
                refuse_unknown(item, item_kind, f"{path}.{index}.", root)


def _item_struct(kind: Any) -> type[msgspec.Struct] | None:
    """The struct that a list's items are, None where they are none: of Annotated[tuple[S, ...], ...] it is S."""
    for part in get_args(kind):
        if isinstance(part, type) and issubclass(part, msgspec.Struct):
            return part
        found = _item_struct(part)
        if found is not None:
            return found
    return None


def _nearest(key: str, here: Iterable[str], where: str, root: type[msgspec.Struct]) -> str:
    """The path of the setting that was meant by `key`: of those `here` the most alike, else the same name elsewhere."""
    near = difflib.get_close_matches(key, here, n=1, cutoff=0.5)
    if near:
        return f"{where}{near[0]}"
    sections: dict[str, type[msgspec.Struct]] = {"": root}
    for field in msgspec.structs.fields(root):
        if isinstance(field.type, type) and issubclass(field.type, msgspec.Struct):
            sections[f"{field.name}."] = field.type
        elif (item_kind := _item_struct(field.type)) is not None:
            sections[f"{field.name}.0."] = item_kind
    return next((f"{path}{key}" for path, struct in sections.items() if key in struct.__struct_fields__), "")


def readable(message: str, table: Any, root: type[msgspec.Struct]) -> str:
    """msgspec's message with the setting's path first, its value beside it, and what is allowed instead."""
    text, _, where = message.partition(" - at `$")
    path = where.rstrip("`").replace("[", ".").replace("]", "").lstrip(".")
    if not path:
        return text
    parts = path.split(".")
    value: Any = table
    for part in parts:
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, ValueError, TypeError):
            return f"{path}: {text}"
    if "Invalid enum value" in text or " | str" in text:
        return expects(path, _allowed(parts, root), value)
    if "regex" in text:
        return expects(path, "letters, digits, blanks and . _ - with a letter or digit first", value)
    what = plain(text)
    return expects(path, what, value) if what else f"{path}: {text}; got {value!r}"


def _allowed(parts: Sequence[str], root: type[msgspec.Struct]) -> str:
    """The values that the enumeration at a path takes: "boxcar", "lowpass" or "none"; a number in a range beside them."""
    kind: Any = root
    for part in parts:
        if part.isdigit():
            kind = _item_struct(kind)
        else:
            kind = next(field.type for field in msgspec.structs.fields(kind) if field.name == part)
    *others, last = _named(kind)
    return f"{', '.join(others)} or {last}"


def _named(kind: Any) -> list[str]:
    """What a type allows, in words; None, which a table cannot say, is left out."""
    if isinstance(kind, str):
        return [f'"{kind}"']
    if kind is NoneType:
        return []
    ranged = [part for part in get_args(kind) if isinstance(part, msgspec.Meta)]
    if ranged:
        noun = "whole number" if get_args(kind)[0] is int else "number"
        return [f"a {noun} from {ranged[0].ge} to {ranged[0].le}"]
    return [text for part in get_args(kind) for text in _named(part)]
