"""Settings from a name, a file or a table."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from cogrip.api.errors import as_api_error
from cogrip.cli.settings.settings_file import from_table, load
from cogrip.protocol.settings.sections import Settings

Source = str | Path | Mapping[str, Any] | Settings
"""A name of `cogrip configs`, a TOML file, a table of settings, or settings."""


def settings(source: Source = "demo", **changes: Any) -> Settings:
    """Return settings, checked, with some of them changed.

    Parameters
    ----------
    source
        A name that comes with cogrip ("demo"), the path of a TOML file, a table as such a file has it, or settings.
    changes
        Values by key, as in a file: `seconds=5.0`, `coupling={"stiffness_npm": 800.0}`. A table changes the keys that it
        has; `users={0: {"hand": "tremor"}}` changes the first person.

    Raises ApiError for an unknown key, a value out of bounds, or a file that cannot be read.
    """
    keys = dict(_flat(changes))
    with as_api_error():
        table = msgspec.to_builtins(source) if isinstance(source, Settings) else source
        if isinstance(table, str | Path):
            return load(Path(table), keys)
        return from_table(dict(table), keys)


def _flat(table: Mapping[Any, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables by dotted key."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}", value
