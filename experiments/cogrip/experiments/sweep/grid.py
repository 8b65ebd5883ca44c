"""The grid of a sweep: axes of values for settings, and their product, case by case."""

from __future__ import annotations

import math
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError

MOST_CELLS = 100_000


class GridError(ValueError):
    """A grid that cannot be; the text names the axis, its value, the bound and the cure."""


@dataclass(frozen=True, slots=True)
class Axis:
    """A settings key and its values, in order; `log`: asked for on a logarithmic scale."""

    key: str
    values: tuple[Any, ...]
    log: bool = False

    @property
    def numeric(self) -> bool:
        return all(isinstance(value, int | float) and not isinstance(value, bool) for value in self.values)


def parse_axis(text: str) -> Axis:
    """Parse `key=a:b:n` (n values, ends included), `key=a:b:nlog`, or `key=v,v,v` (TOML values, or bare words).

    Raises GridError.
    """
    key, equals, spec = (part.strip() for part in text.partition("="))
    if not equals or not key or not spec:
        raise GridError(
            f"--vary {text!r}: write it as key=first:last:count, key=first:last:countlog or key=value,value"
        )
    if ":" in spec and "," not in spec:  # addresses of devices have colons
        return _span(key, spec, text)
    values = tuple(_value(part.strip()) for part in spec.split(","))
    if any(value == "" for value in values):
        raise GridError(f"--vary {text!r}: a value between two commas is missing")
    if len(set(map(repr, values))) < len(values):
        raise GridError(f"--vary {text!r}: a value stands twice")
    return Axis(key, values)


def _span(key: str, spec: str, text: str) -> Axis:
    parts = spec.split(":")
    if len(parts) != 3:
        raise GridError(f"--vary {text!r}: a span has three parts, first:last:count or first:last:countlog")
    count_text = parts[2].removesuffix("log")
    log = count_text != parts[2]
    try:
        first, last, count = float(parts[0]), float(parts[1]), int(count_text)
    except ValueError:
        raise GridError(f"--vary {text!r}: {spec!r} is no span; write numbers, such as 100:20000:40log") from None
    if not (math.isfinite(first) and math.isfinite(last)):
        raise GridError(f"--vary {text!r}: both ends must be finite")
    if count < 1 or (count == 1 and first != last):
        raise GridError(
            f"--vary {text!r}: a span from {first:g} to {last:g} needs a count of at least {1 + (first != last)}"
        )
    if count > 1 and first == last:
        raise GridError(f"--vary {text!r}: from {first:g} to {last:g} there are no {count} different values")
    if log and not (first > 0.0 and last > 0.0):
        raise GridError(f"--vary {text!r}: a logarithmic span needs both ends above 0")
    values = (np.geomspace if log else np.linspace)(first, last, count).tolist()
    values[0], values[-1] = first, last
    whole = all(value == round(value) for value in values) and not any(mark in spec for mark in ".eE")
    return Axis(key, tuple(int(value) for value in values) if whole else tuple(values), log)


def _value(text: str) -> Any:
    """Return a TOML value, or the text itself as a bare word."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text  # a bare word
    except RecursionError:
        raise GridError(f"--vary: {text[:20]}... is nested too deep; give plain values") from None


class Grid:
    """The product of the axes over base settings; the last axis runs fastest. Raises GridError, or SettingsError for a cell."""

    def __init__(self, base: Mapping[str, Any], axes: Sequence[Axis]) -> None:
        key, count = Counter(axis.key for axis in axes).most_common(1)[0] if axes else ("", 0)
        if count > 1:
            raise GridError(f"--vary {key}: stands twice; give all its values at once")
        if not axes:
            raise GridError("nothing to vary: give at least one --vary key=...")
        self.base = base
        self.axes = tuple(axes)
        self.cases = math.prod(len(axis.values) for axis in axes)
        if self.cases > MOST_CELLS:
            raise GridError(f"{self.cases} cells are more than {MOST_CELLS}: give fewer values, or several sweeps")

    @property
    def keys(self) -> tuple[str, ...]:
        """The settings that are varied."""
        return tuple(axis.key for axis in self.axes)

    def values(self, case: int) -> dict[str, Any]:
        """Return what case number `case` sets."""
        indices = np.unravel_index(case, [len(axis.values) for axis in self.axes])
        return {axis.key: axis.values[index] for axis, index in zip(self.axes, indices, strict=True)}

    def settings(self, case: int) -> Settings:
        """Return the settings of a case. Raises SettingsError."""
        return resolve(self.base, self.values(case))

    def each_value(self) -> Iterator[Settings]:
        """Yield settings with each value of each axis once, the other axes at their first value."""
        first = self.values(0)
        for axis in self.axes:
            for value in axis.values:
                yield resolve(self.base, {**first, axis.key: value})

    def check(self) -> None:
        """Resolve every case before any is run. Raises GridError with the case's values."""
        for case in self:
            try:
                self.settings(case)
            except SettingsError as error:
                values = ", ".join(f"{key}={value}" for key, value in self.values(case).items())
                raise GridError(f"case {case} ({values}): {error}") from None

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.cases))
