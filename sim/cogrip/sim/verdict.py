"""A run's summary in plain words and readable units, for the report and the terminal. Whatever is missing is said to be."""

import math
from collections.abc import Iterator
from typing import Any

Summary = dict[str, Any]
UNKNOWN = "not known"
MARGINS = {"up_margin_j": "line up", "down_margin_j": "line down", "line_margin_j": "whole line"}
_ROUNDING_J = 1e-12  # what summary.json's `passive` allows for rounding
_BALANCE_J = 1e-9  # what rounding can put the books of one step out by, generously
_SHOWN_PEOPLE = 6
MUCH_LATE, MANY_LATE = 0.05, 20  # share, and number, of one direction's frames from which on a depth is too shallow


def dig(table: Any, *keys: str) -> Any:
    """table[key][key]..., None where there is no such thing."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def number(value: Any, *, scale: float = 1.0, digits: int = 1) -> str:
    """`value` in display units, or UNKNOWN; what is no number at all stands as it is."""
    if is_number(value):
        text = f"{value * scale:.{digits}f}"
        return text.replace("-", "−") if float(text) else text.lstrip("-")
    return UNKNOWN if value is None else str(value)[:80]


def vector(values: Any, *, scale: float = 1.0, digits: int = 1) -> str:
    """Components side by side, or UNKNOWN."""
    if not isinstance(values, (list, tuple)):
        return number(values, scale=scale, digits=digits)
    return ", ".join(number(value, scale=scale, digits=digits) for value in values) or UNKNOWN


def energy(value_j: Any) -> str:
    """With the unit that fits; rounding errors are 0 J."""
    if not is_number(value_j):
        return number(value_j)
    if abs(value_j) <= _ROUNDING_J:
        return "0 J"
    for unit, size_j in (("J", 1.0), ("mJ", 1e-3), ("µJ", 1e-6), ("nJ", 1e-9), ("pJ", 1e-12)):
        if abs(value_j) >= size_j:
            return f"{value_j / size_j:.3g} {unit}".replace("-", "−")
    return f"{value_j:.1g} J"


def people(summary: Summary) -> list[dict[str, Any]]:
    users = summary.get("users")
    return [user for user in users if isinstance(user, dict)] if isinstance(users, list) else []


def earlier(user: dict[str, Any]) -> list[dict[str, Any]]:
    """The sittings of a person before the last, oldest first."""
    before = user.get("earlier")
    return [each for each in before if isinstance(each, dict)] if isinstance(before, list) else []


def sittings(users: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Every sitting of everybody."""
    return [sitting for user in users for sitting in (*earlier(user), user)]


def overdrawn(users: list[dict[str, Any]], tank_j: float) -> bool:
    """Whether a margin that is a number is below what its ledger may lend: the tank of each direction."""
    bounds = {key: -(2.0 if key == "line_margin_j" else 1.0) * tank_j - _ROUNDING_J for key in MARGINS}
    return any(
        is_number(value := dig(user, "energy", key)) and value < bounds[key]
        for user in sittings(users)
        for key in ledgers(user)
    )


def ledgers(user: dict[str, Any]) -> dict[str, str]:
    """Those that the verdict rests on: not the one that only somebody else's client kept."""
    return {key: words for key, words in MARGINS.items() if key != "down_margin_j" or not user.get("claimed")}


def name_of(user: dict[str, Any]) -> str:
    return str(user.get("name") or "nameless")


def worst_margin(users: list[dict[str, Any]]) -> tuple[float, str, str] | None:
    """(energy [J], which ledger, whose); None where no end told."""
    found = [
        (float(value), words, name_of(user))
        for user in sittings(users)
        for key, words in ledgers(user).items()
        if is_number(value := dig(user, "energy", key))
    ]
    return min(found) if found else None


def ticks_share(ticks: Any) -> float | None:
    """Ticks run of those that were due, 0 to 1."""
    due, run = dig(ticks, "due"), dig(ticks, "run")
    return run / due if is_number(due) and is_number(run) and due > 0 else None


def share(value: float | None) -> str:
    """Percent that says 100 only if nothing is missing."""
    if value is None:
        return UNKNOWN
    return "100 %" if value >= 1.0 else f"{min(value * 100.0, 99.99):.2f} %"


def verdict(summary: Summary, tank_j: float | None = None) -> list[tuple[str, str]]:
    """Sentences, each with its tone: `good`, `warn`, `bad`. tank_j: what the lines may lend (settings), None if not known."""
    if not summary:
        return [("bad", "There is no summary of this run: only what its traces hold can be shown.")]
    return [
        _passive(summary, tank_j),
        _diverged(summary),
        *_claims(summary),
        *_balance(summary),
        *_states(summary),
        *_late(summary),
        *_loops(summary),
    ]


def _passive(summary: Summary, tank_j: float | None) -> tuple[str, str]:
    worst = worst_margin(people(summary))
    said = summary.get("passive")
    if said is False and not overdrawn(people(summary), tank_j or 0.0):
        least = f"the least that is one is {energy(worst[0])} ({worst[1]} of {worst[2]})" if worst else "none is one"
        return "bad", f"Not passive as far as can be told: an end told an energy margin that is no number; {least}."
    if worst is None or not isinstance(said, bool):
        return "warn", "Whether the run was passive is not known: no end told its energy margin."
    margin_j, ledger, who = worst
    where = f"{ledger} of {who}"
    lent = f" The tank may lend {energy(tank_j)}." if tank_j else ""
    if not said:
        put_in = "its client says was" if any(user.get("claimed") for user in people(summary)) else "had been"
        return "bad", f"Not passive: the {where} gave out {energy(-margin_j)} more than {put_in} put in.{lent}"
    if margin_j < -_ROUNDING_J:
        lender = "its tank" if tank_j else "its passivity controller, E(0),"
        return "good", f"Passive: the {where} was {energy(-margin_j)} ahead at most, which {lender} had lent.{lent}"
    return (
        "good",
        f"Passive: no line ever gave out more energy than had been put in (least margin {energy(margin_j)}).{lent}",
    )


def _diverged(summary: Summary) -> tuple[str, str]:
    said = summary.get("diverged")
    if said is False:
        return "good", "Nothing diverged."
    if said is not True:
        return "warn", "Whether anything diverged is not known."
    why = [
        f"{name_of(user)}: {user['reason']}"
        for user in people(summary)
        if user.get("reason") and not user.get("claimed")
    ]
    where = vector(dig(summary, "object", "position_m"), scale=1e3)
    return "bad", f"Diverged. {'; '.join(why) or f'The object left the workspace, it was last at {where} mm'}."


def _claims(summary: Summary) -> Iterator[tuple[str, str]]:
    """What only the clients of others say: it is theirs, and decides nothing."""
    for user in people(summary):
        for sitting in (*earlier(user), user):
            claimed, margin_j = sitting.get("claimed"), dig(sitting, "claimed", "down_margin_j")
            if dig(claimed, "diverged"):
                reason = sitting.get("reason")
                yield "warn", f"The client of {name_of(user)} says that it diverged{f' ({reason})' if reason else ''}."
            if is_number(margin_j) and margin_j < -_ROUNDING_J:
                yield (
                    "warn",
                    f"The client of {name_of(user)} says that the line down gave out {energy(-margin_j)} too much.",
                )


def _balance(summary: Summary) -> Iterator[tuple[str, str]]:
    error_j = dig(summary, "server", "energy_balance_error_j")
    if is_number(error_j) and error_j > _BALANCE_J:
        yield "warn", f"The object's step does not keep its books: one step made or lost up to {energy(error_j)}."


def in_fault(summary: Summary) -> bool:
    """Whether anybody's device ended in a fault."""
    return any(user.get("state") == "fault" for user in summary["users"])


def _states(summary: Summary) -> Iterator[tuple[str, str]]:
    for user in people(summary):
        state, reason = user.get("state"), user.get("reason")
        if state is None:
            yield "warn", f"The client of {name_of(user)} was never heard: what it alone knows is missing."
        elif state in ("fault", "degraded") and not summary.get("diverged"):
            said = ", its client says" if user.get("claimed") else ""
            yield (
                ("bad" if state == "fault" else "warn"),
                f"{name_of(user)} ended in {state}{said}: {reason or 'no reason given'}.",
            )


def _late(summary: Summary) -> Iterator[tuple[str, str]]:
    """A depth of playout that was set, and is too shallow for the network that there was; only waves are played out."""
    frames = summary.get("playout_frames")
    if not is_number(frames):
        return  # it follows the network, or nobody says
    found = []
    for user in sittings(people(summary)):
        for way in ("up", "down"):
            late, sent = dig(user, "link", way, "late"), dig(user, "link", way, "sent")
            if not (dig(user, "playout", way) and is_number(late) and is_number(sent)):
                continue
            if late >= max(MANY_LATE, MUCH_LATE * sent):
                found.append((late / max(late, sent), "from" if way == "up" else "to", name_of(user)))
    if found:
        part, way, name = max(found)
        others = f" (and 5 % or more in {len(found) - 1} of the other directions)" if len(found) > 1 else ""
        text = (
            f"{100.0 * part:.0f} % of the frames {way} {name}{others} came too late for playout.frames = {frames} and were "
            'not played: a larger number waits for more of them, "auto" follows the network.'
        )
        yield "warn", text


def _loops(summary: Summary) -> Iterator[tuple[str, str]]:
    loops = [(name_of(user), user.get("ticks")) for user in people(summary)]
    loops.append(("the server", dig(summary, "server", "ticks")))
    shares = [(part, name) for name, ticks in loops if (part := ticks_share(ticks)) is not None]
    if not shares:
        yield "warn", "How many ticks were run is not known."
        return
    least = min(shares)[0]
    if least >= 1.0:
        text = "Every loop ran every tick"
    elif len(shares) <= _SHOWN_PEOPLE:
        text = "Ticks run: " + ", ".join(f"{name} {share(part)}" for part, name in shares)
    else:
        text = f"Ticks run: {share(least)} at worst, by {min(shares)[1]}"
    late = [(value, name) for name, ticks in loops if is_number(value := dig(ticks, "late_us", "p99"))]
    if late:
        value, name = max(late)
        text += f"; 99 of 100 ticks came within {value:.0f} µs of their time (the latest: {name})"
    yield ("good" if least >= 0.999 else "warn" if least >= 0.99 else "bad"), f"{text}."
