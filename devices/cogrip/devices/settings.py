"""Addresses and their query keys: `scheme:name?key=value&key=value` (or `#` for `?`), every key checked against a typed record.

Nothing is percent-decoded: a value may hold any character but `&`, so that a file name stands as it is.
"""

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta

from cogrip.devices.device import DeviceError
from cogrip.protocol.settings.errors import expects, plain

Setting: TypeAlias = str | float | Sequence[float]
"""A value as it comes: text from an address, or a number or numbers from Python."""

Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(ge=1e-9, le=1e6)]
NotNegative = Annotated[float, Meta(ge=0.0, le=1e6)]

MOST_AXES = 3
_Settings = TypeVar("_Settings", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class Address:
    """A device address in its parts."""

    text: str
    scheme: str
    name: str
    query: dict[str, str]


def parse_address(text: str) -> Address:
    """Split `scheme:name?key=value&...`. The name ends at the first `?` or `#`; a key ends at the first `=`.

    Raises DeviceError without a scheme, on an item that is not `key=value`, and on a key given twice.
    """
    scheme, colon, remainder = text.partition(":")
    if not colon or not scheme:
        raise DeviceError(f"device address {text!r} has no scheme: write scheme:name, such as sim:phantom?hand=reach")
    name, *tail = re.split("[?#]", remainder, maxsplit=1)
    query: dict[str, str] = {}
    for item in tail[0].split("&") if any(tail) else ():
        key, equals, value = item.partition("=")
        if not equals or not key or not value:
            raise DeviceError(f"{text!r}: {item!r} is not key=value")
        if key in query:
            raise DeviceError(f"{text!r}: key {key!r} is given twice ({query[key]!r} and {value!r}); give it once")
        query[key] = value
    return Address(text, scheme, name, query)


def unknown(what: str, given: str, known: Iterable[str], where: str) -> DeviceError:
    """The error for a name nobody knows: the name, the nearest right one, and the list."""
    names = list(known)
    near = difflib.get_close_matches(given, names, n=1, cutoff=0.5)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return DeviceError(f"{where}: unknown {what} {given!r}{hint} There are: {', '.join(names) or 'none'}")


def keys_of(settings: type[msgspec.Struct]) -> tuple[str, ...]:
    """The query keys a record takes, in order."""
    return settings.__struct_fields__


def read_settings(settings: type[_Settings], query: Mapping[str, Setting], where: str) -> _Settings:
    """Check `query` against the record `settings`: text becomes numbers, `a,b,c` becomes a tuple of numbers.

    Raises DeviceError naming key, value, and what was expected. Unknown keys are the caller's to find first.
    """
    hints = _hints_of(settings)
    vectors = {key for key, hint in hints.items() if get_origin(hint) is tuple}
    typed = {key: _as_vector(value) if key in vectors else value for key, value in query.items()}
    try:
        return msgspec.convert(typed, settings, strict=False)
    except msgspec.ValidationError as error:
        message = str(error)
    # msgspec says `... - at `$.key[i]``, or `... missing required field `key``
    text, _, path = message.partition(" - at `$.")
    key = path.rstrip("`").partition("[")[0]
    if key in query:
        if get_origin(hints[key]) is Literal:
            what = f"one of {', '.join(str(choice) for choice in get_args(hints[key]) if choice)}"
        else:
            what = plain(text) or f"{text[0].lower()}{text[1:]}"
        if key in vectors:
            what = f"{what}, or several with commas between"
        raise DeviceError(f"{where}: {expects(key, what, query[key])}")
    needed = message.rpartition("field `")[2].rstrip("`")
    raise DeviceError(f"{where}: needs the key {needed!r}; add {needed}=...")


@cache
def _hints_of(settings: type[msgspec.Struct]) -> Mapping[str, Any]:
    """Return key -> type; a list of devices asks for those of the same records again and again."""
    return get_type_hints(settings)


def read_query(settings: type[_Settings], query: Mapping[str, Setting], where: str) -> _Settings:
    """Check `query` against the record `settings`, unknown keys too. Raises DeviceError."""
    for key in query:
        if key not in keys_of(settings):
            raise unknown("key", key, keys_of(settings), where)
    return read_settings(settings, query, where)


def check_axes(axes: int, where: str, most: int = MOST_AXES, why: str = "") -> None:
    """Raises DeviceError for a number of axes out of 1 to `most`. why: what is said besides."""
    if not 1 <= axes <= most:
        raise DeviceError(f"{where}: axes={axes} is out of 1 to {most}{why}")


def bounded(
    given: tuple[float, ...], count: int, key: str, where: str, bounds: tuple[float, float], *, whole: bool = False
) -> tuple[float, ...]:
    """`given` itself, empty or `count` numbers within `bounds`; whole: each is one of the bounds. Raises DeviceError."""
    low, high = bounds
    good = len(given) == count and all((value in bounds) if whole else (low <= value <= high) for value in given)
    if given and not good:
        kind = f"{low:g} or {high:g}" if whole else f"{low:g} to {high:g}"
        said = ",".join(f"{value:g}" for value in given)
        raise DeviceError(f"{where}: {key}={said}: give {('one', 'two', 'three')[count - 1]} numbers, each {kind}")
    return given


def fit_axes(vector: Sequence[float], axes: int, key: str) -> tuple[float, ...]:
    """`vector` as `axes` numbers: missing ones are 0. Raises DeviceError when it has more than the device has axes."""
    if len(vector) > axes:
        raise DeviceError(
            f"{key}={','.join(map(str, vector))} has {len(vector)} numbers, the device {axes} axes; give {axes}"
        )
    return tuple(map(float, vector)) + (0.0,) * (axes - len(vector))


def _as_vector(value: Setting) -> list[str] | list[float]:
    if isinstance(value, str):
        return value.split(",")
    return [float(value)] if isinstance(value, int | float) else list(value)
