"""Origin of a setting that is wrong: the flag that gave it, else the settings file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.table import SettingsError

SET = "--set "


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the settings of one session come from.

    file    what an error of the file begins with, such as `demo: `
    given   values of flags by dotted key
    typed   whether they were typed, as `--set` or another flag; a program gives them by key alone
    flags   key -> flag, of those that another flag than `--set` gave
    """

    file: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)
    typed: bool = True
    flags: Mapping[str, str] = field(default_factory=dict)

    def before(self, *keys: str) -> str:
        """Return what a text that begins with one of these keys is put behind: the flag that gave it, else the file."""
        key = next((key for key in keys if key in self.given), None)
        if key is None:
            return self.file
        return f"{self.flags[key]}: " if key in self.flags else SET if self.typed else ""

    def explained(self, table: Mapping[str, Any], error: SettingsError) -> str:
        """Return the error of `table` with these flags, behind the first one without which it would not be there."""
        text = str(error)
        for key, value in self.given.items():
            try:
                resolve(table, {other: each for other, each in self.given.items() if other != key})
            except SettingsError as without:
                if str(without) == text:
                    continue
            named = text if text.startswith(key) or key in self.flags else f"{key}={value}: {text}"
            return f"{self.before(key)}{named}"
        return f"{self.file}{text}"
