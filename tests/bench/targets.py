"""Targets of measurements, reached or not; and settings that a benchmark gives each session itself."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console

from cogrip.cli.terminal.problem import BadInput


def reached(well: bool) -> str:
    """Return the word for it."""
    return "reached" if well else "NOT reached"


def judge(console: Console, what: str, value: float, asked: float, *, most: bool = False, form: str = ".2f") -> bool:
    """Print a value beside the least, or the most, that is asked for; return whether it is reached."""
    well = value <= asked if most else value >= asked
    unit = " %" if form.endswith("%") else ""
    bound = f"{100 * asked if unit else asked:g}{unit}"
    shown = f"{100 * value:{form[:-1]}f}{unit}" if unit else format(value, form)
    console.print(
        f"{what}: {shown}; at {'most' if most else 'least'} {bound} is asked for: {reached(well)}", markup=False
    )
    return well


def refuse_own(bench: str, changes: Mapping[str, Any], own: Mapping[str, str]) -> None:
    """Raises BadInput for a key of `own`, one in such a section, or a whole section with such a key in it.

    changes: what `--set` asks for, by path; own: paths of settings, and what to do instead.
    """
    for key, value in changes.items():
        for path, cure in own.items():
            if f"{key}.".startswith(f"{path}.") or path.startswith(f"{key}."):
                raise BadInput(f"--set {key}={value}: {bench} sets {path} itself in each session; {cure}")
