"""Measures of a sweep: paths into `summary.json`, or names of numbers of the lifted model.

A path is keys and list indices with dots between, as `users.0.peak_force_n`; `*` stands for every item of a list.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from cogrip.analysis.feel.feel import Slow, on_wall, slow_feel
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import linear_session
from cogrip.analysis.linear.stability import largest_stable, verdict
from cogrip.protocol.settings.sections import Settings
from cogrip.results.reading.folder import finite

DEFAULT = ("passive", "unstable", "users.*.peak_force_n", "users.*.energy.line_margin_j", "object.travel_m")
SCENE = tuple(f"server.scene.{name}" for name in ("lifted_m", "lifted_s", "lifted_slip_m", "slip_m", "peak_contact_n"))
PREFIX = "lifted."


def _model(settings: Settings) -> LiftedModel:
    return LiftedModel(linear_session(settings))


def _slow(settings: Settings) -> Slow:
    return slow_feel(on_wall(linear_session(settings), 0), 0)


LIFTED: dict[str, Callable[[Settings], float | bool | None]] = {
    "lifted.spectral_radius": lambda settings: verdict(_model(settings)).spectral_radius,
    "lifted.radius_without_structural": lambda settings: verdict(_model(settings)).decaying,
    "lifted.decaying_radius": lambda settings: verdict(_model(settings)).decaying,  # its former name
    "lifted.stable": lambda settings: verdict(_model(settings)).stable,
    "lifted.largest_stable_stiffness_npm": lambda settings: largest_stable(_model(settings)).stiffness_npm,
    "lifted.felt_stiffness_npm": lambda settings: _slow(settings).stiffness_npm,
    "lifted.felt_damping_nspm": lambda settings: _slow(settings).damping_nspm,
    "lifted.felt_inertia_kg": lambda settings: _slow(settings).inertia_kg,
}
"""Numbers of the lifted model of the whole session; felt values are those of user 0 of an object that cannot move."""


def defaults(settings: Settings) -> tuple[str, ...]:
    """Return the measures of sessions of such settings where none are named."""
    return DEFAULT + (SCENE if settings.object.traits.scene else ())


class MeasureError(ValueError):
    """An unknown measure; the text names near ones."""


def expanded(measures: Sequence[str], example: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the path of every column, `*` expanded by an example summary. Raises MeasureError."""
    columns: list[str] = []
    for measure in measures:
        if measure.startswith(PREFIX):
            if measure not in LIFTED:
                raise MeasureError(_unknown(measure, LIFTED))
            found = [measure]
        else:
            found = [path for path in leaves(example) if _matches(measure.split("."), path.split("."))]
            if not found:
                raise MeasureError(_unknown(measure, [*leaves(example), *LIFTED]))
        columns += [column for column in found if column not in columns]
    return tuple(columns)


def needs_session(measures: Sequence[str]) -> bool:
    """Return whether any measure is read of a session."""
    return not all(measure.startswith(PREFIX) for measure in measures)


def leaves(value: Any, path: str = "") -> Iterator[str]:
    """Yield the path of every number, string, boolean and null of a summary."""
    if not isinstance(value, Mapping | list):
        yield path
        return
    for key, item in value.items() if isinstance(value, Mapping) else enumerate(value):
        yield from leaves(item, f"{path}.{key}" if path else str(key))


def read(summary: Mapping[str, Any], column: str) -> Any:
    """Return the value at a path; None where there is none, or no finite number."""
    value: Any = summary
    for part in column.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, TypeError):
            return None
    return finite(value)


def _matches(pattern: Sequence[str], path: Sequence[str]) -> bool:
    return len(pattern) == len(path) and all(one in ("*", other) for one, other in zip(pattern, path, strict=True))


def _unknown(measure: str, known: Any) -> str:
    near = difflib.get_close_matches(measure, list(known), n=3, cutoff=0.5)
    inside = [path for path in known if path.startswith(f"{measure}.")][:3]
    cure = (
        f"did you mean {', '.join(inside or near)}?" if inside or near else "see a run's summary.json for what there is"
    )
    return f"--measure {measure}: there is no such measure; {cure}"
