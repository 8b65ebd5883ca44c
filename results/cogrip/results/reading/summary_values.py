"""Values of a run's `summary.json`, and numbers in readable units; missing values read UNKNOWN."""

import math
from typing import Any

from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS, UNLENT_MJ, CouplingKind, lent_mj
from cogrip.protocol.settings.object_kinds import ObjectKind, kind_of

Summary = dict[str, Any]
UNKNOWN = "not known"
MARGINS = {"up_margin_j": "line up", "down_margin_j": "line down", "line_margin_j": "whole line"}
ROUNDING_J = 1e-12  # rounding that margins are allowed
FORCELESS = ("fault", "degraded")  # states of a client's safety that let no force through at the end


def dig(table: Any, *keys: str) -> Any:
    """Return table[key][key]..., None where there is no such thing."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def number(value: Any, *, scale: float = 1.0, digits: int = 1) -> str:
    """Return a value in display units, or UNKNOWN; any other thing than a number as its text."""
    if is_number(value):
        text = f"{value * scale:.{digits}f}"
        return text.replace("-", "−") if float(text) else text.lstrip("-")
    return UNKNOWN if value is None else str(value)[:80]


def vector(values: Any, *, scale: float = 1.0, digits: int = 1) -> str:
    """Return components side by side, or UNKNOWN."""
    if not isinstance(values, (list, tuple)):
        return number(values, scale=scale, digits=digits)
    return ", ".join(number(value, scale=scale, digits=digits) for value in values) or UNKNOWN


def energy(value_j: Any) -> str:
    """Return an energy with the unit that fits; rounding errors are 0 J."""
    if not is_number(value_j):
        return number(value_j)
    if abs(value_j) <= ROUNDING_J:
        return "0 J"
    for unit, size_j in (("J", 1.0), ("mJ", 1e-3), ("µJ", 1e-6), ("nJ", 1e-9), ("pJ", 1e-12)):
        if abs(value_j) >= size_j:
            return f"{value_j / size_j:.3g} {unit}".replace("-", "−")
    return f"{value_j:.1g} J"


_GOALS = (
    ("lifted_m", "lifted", "at least", 1e3, 1, "mm"), ("turned_rad", "turned", "at least", 1.0, 3, "rad"),
    ("within_m", "off its place", "at most", 1e3, 2, "mm"), ("tilt_rad", "tilted", "at most", 1.0, 3, "rad"),
)  # fmt: skip


def task_of(summary: Summary) -> dict[str, Any] | None:
    """Return the result of the task; None where the settings stated none."""
    task = summary.get("task")
    return task if isinstance(task, dict) else None


def task_result(task: dict[str, Any]) -> str:
    """Return whether a task was reached, and when."""
    return f"reached after {number(task.get('at_s'), digits=2)} s" if task.get("reached") is True else "not reached"


def task_goals(task: dict[str, Any]) -> list[tuple[str, str]]:
    """Return each goal of a task in words, and what came of it."""
    return [
        (
            words,
            f"{number(dig(task, 'goals', key, 'value'), scale=scale, digits=digits)} {unit} ({most} {scale * asked:g})",
        )
        for key, words, most, scale, digits, unit in _GOALS
        if is_number(asked := dig(task, "goals", key, "asked"))
    ]


def people(summary: Summary) -> list[dict[str, Any]]:
    users = summary.get("users")
    return [user for user in users if isinstance(user, dict)] if isinstance(users, list) else []


def earlier(user: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the seat sessions of a person before the last, oldest first."""
    before = user.get("earlier")
    return [each for each in before if isinstance(each, dict)] if isinstance(before, list) else []


def seat_sessions(users: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return every seat session of everybody."""
    return [seat_session for user in users for seat_session in (*earlier(user), user)]


def name_of(user: dict[str, Any]) -> str:
    return str(user.get("name") or "nameless")


def ticks_share(ticks: Any) -> float | None:
    """Return the share of due ticks that were run, 0 to 1."""
    due, run = dig(ticks, "due"), dig(ticks, "run")
    return run / due if is_number(due) and is_number(run) and due > 0 else None


def share(value: float | None) -> str:
    """Return percent; 100 only if nothing is missing."""
    if value is None:
        return UNKNOWN
    return "100 %" if value >= 1.0 else f"{min(value * 100.0, 99.99):.2f} %"


def ledgers(user: dict[str, Any]) -> dict[str, str]:
    """Return the lines' margins that the verdict rests on: none that only somebody else's client kept."""
    return {key: words for key, words in MARGINS.items() if key not in (user.get("claimed") or ())}


def least_reserve(users: list[dict[str, Any]], key: str) -> tuple[float, str] | None:
    """Return (least energy reserve after the first second [J], whose), by its key in `energy`; None if no end reported it."""
    found = [
        (float(value), name_of(user)) for user in seat_sessions(users) if is_number(value := dig(user, "energy", key))
    ]
    return min(found, default=None)


def traits_of(settings: Any) -> CouplingKind | None:
    """Return the properties of the coupling of a run, by its settings; None where they do not tell."""
    kind = dig(settings, "coupling", "kind")
    return COUPLING_KINDS.get(kind) if isinstance(kind, str) else None  # type: ignore[call-overload]


def object_of(settings: Any) -> ObjectKind:
    """Return the properties of a run's object, by its settings; those of a kind that is not known where they do not tell."""
    kind = dig(settings, "object", "kind")
    return kind_of(kind if isinstance(kind, str) else "")


def lent_j(settings: Any) -> float | None:
    """Return what each direction of a line may give out beyond what came in [J], by the settings of a run.

    None where they do not tell.
    """
    tank_mj, kind = dig(settings, "playout", "tank_mj"), dig(settings, "coupling", "kind")
    if not is_number(tank_mj):
        return None
    return 1e-3 * lent_mj(kind, tank_mj) if kind in COUPLING_KINDS else 1e-3 * float(tank_mj)


def told_gates(
    number: int, budget_j: float, margin_j: float | None = None, taken_j: dict[str, float] | None = None
) -> dict[str, Any]:
    """Return `gates` of a summary. margin_j, taken_j: None where no recordings tell of them."""
    tolerance_j = 1e-3 * UNLENT_MJ * number
    return {
        "people": number, "budget_j": budget_j, "tolerance_j": tolerance_j, "margin_j": margin_j, "taken_j": taken_j,
    }  # fmt: skip


def worst_margin(users: list[dict[str, Any]]) -> tuple[float, str, str] | None:
    """Return (energy [J], which ledger, whose); None where no end reported it."""
    found = [
        (float(value), words, name_of(user))
        for user in seat_sessions(users)
        for key, words in ledgers(user).items()
        if is_number(value := dig(user, "energy", key))
    ]
    return min(found) if found else None
