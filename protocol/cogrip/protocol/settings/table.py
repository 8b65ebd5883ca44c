"""The raw table of settings, before the schema: overrides, unknown keys, and errors with a cure.

A table is nested dicts and lists; `users.0.name` is the path of a key in it.
"""

import difflib
from collections.abc import Iterable, Mapping, Sequence
from types import NoneType
from typing import Any, get_args

import msgspec

from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.settings.errors import expects, plain


class SettingsError(ForeignFileError, ValueError):
    """A setting that is missing, unknown, of the wrong kind, out of bounds, or does not fit another one."""


def parse_override(text: str) -> tuple[str, str]:
    """Split `section.key=value`. Raises SettingsError."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise SettingsError(f"--set {text!r}: write it as section.key=value, for instance coupling.stiffness_npm=500")
    return key.strip(), value.strip()


def copied(value: Any) -> Any:
    """Return a deep copy of a table as dicts and lists."""
    if isinstance(value, Mapping):
        return {key: copied(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [copied(item) for item in value]
    return value


def override(table: dict[str, Any], key: str, value: Any, only_user: str) -> None:
    """Set one key by its path. only_user: name of the only user of a table without users. Raises SettingsError."""
    *path, last = key.split(".")
    here: Any = table
    for depth, part in enumerate(path):
        if isinstance(here, dict):
            here = here.setdefault(part, [{"name": only_user}] if part == "users" else {})
        elif part.isdigit() and int(part) < len(here):
            here = here[int(part)]
        else:
            raise SettingsError(f"{key}: there is no user number {part} (users are numbered 0 to {len(here) - 1})")
        if not isinstance(here, (dict, list)):
            raise SettingsError(f"{key}: {'.'.join(path[: depth + 1])} is a value, not a section")
    if isinstance(here, list):
        raise SettingsError(f"{key}: name a user's number and key, for instance users.0.stiffness_npm")
    here[last] = value


def refuse_unknown(
    table: Any, struct: type[msgspec.Struct], where: str = "", root: type[msgspec.Struct] | None = None
) -> None:
    """Check keys. Raises SettingsError for one that `struct`, or a struct in it, does not have. where: path of `table`."""
    root = root or struct
    if not isinstance(table, dict):
        return
    fields = {field.name: field.type for field in msgspec.structs.fields(struct)}
    for key, value in table.items():
        path = f"{where}{key}"
        if key not in fields:
            near = _nearest(str(key), value, fields, where, root)
            cure = f"did you mean {near}?" if near else f"known here: {', '.join(fields)}"
            raise SettingsError(f"{path}: there is no such setting; {cure}")
        kind = fields[key]
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            refuse_unknown(value, kind, f"{path}.", root)
        elif isinstance(value, list) and (item_kind := _item_struct(kind)) is not None:
            for index, item in enumerate(value):
                refuse_unknown(item, item_kind, f"{path}.{index}.", root)


def _item_struct(kind: Any) -> type[msgspec.Struct] | None:
    """Return the struct type of a list's items, None where they are none: S of Annotated[tuple[S, ...], ...]."""
    for part in get_args(kind):
        found = part if isinstance(part, type) and issubclass(part, msgspec.Struct) else _item_struct(part)
        if found is not None:
            return found
    return None


def _nearest(key: str, value: Any, here: Iterable[str], where: str, root: type[msgspec.Struct]) -> str:
    """Return the path of the setting that `key` probably means: the most similar of `here`, else the same name elsewhere.

    A section that is not there may be one of no section: of `session.seconds` that is `seconds`.
    """
    top = root.__struct_fields__
    if not where and isinstance(value, dict) and (inner := next((name for name in value if name in top), "")):
        return inner
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
    """Return msgspec's message with the setting's path, its value, and the allowed ones."""
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
    """Return the values that the enumeration at a path allows: "boxcar", "lowpass" or "none"; or a number in a range."""
    kind: Any = root
    for part in parts:
        if part.isdigit():
            kind = _item_struct(kind)
        else:
            kind = next(field.type for field in msgspec.structs.fields(kind) if field.name == part)
    *others, last = _named(kind)
    return f"{', '.join(others)} or {last}"


def _named(kind: Any) -> list[str]:
    """Return the allowed values of a type as texts; None, which a table cannot hold, is left out."""
    if isinstance(kind, str):
        return [f'"{kind}"']
    if kind is NoneType:
        return []
    ranged = [part for part in get_args(kind) if isinstance(part, msgspec.Meta)]
    if ranged:
        noun = "whole number" if get_args(kind)[0] is int else "number"
        return [f"a {noun} from {ranged[0].ge} to {ranged[0].le}"]
    return [text for part in get_args(kind) for text in _named(part)]
