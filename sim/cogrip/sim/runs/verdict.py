"""Three judgements of a run, for the whole chain from hand to object, devices included: passive, stable, felt as intended.

Each is good only where every end told what it takes to know: what is missing warns. The rules are the same wherever a run is
judged (`lab`, `demo`, `join`, `serve`, reports, `runs`, `compare`, exit codes); docs/verdict.md lists them with their bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from cogrip.sim.runs.summary_values import (
    MARGINS,
    ROUNDING_J,
    Summary,
    dig,
    earlier,
    energy,
    is_number,
    least_reserve,
    name_of,
    number,
    overdrawn,
    people,
    seat_sessions,
    vector,
    worst_margin,
)

Tone = Literal["good", "warn", "bad"]
Row = dict[str, Any]

MOST_LIMITED = 0.01
"""Of the ticks that may give force: a limit of the device held the force, so the hand felt the limit. 10 ms in a second."""
MOST_CONTROLLED = 0.05
"""Of the same ticks: the device port changed the force, or rendered less impedance than was asked for."""
MOST_REPLACED = 0.05
"""Of one direction's frames: not there in time, and concealed. Telehaptics bears losses of 10 % (docs/decisions/0010)."""
MOST_REPLACED_AT_REST = 0.001
"""Of one direction's frames less its longest gap, for the prediction: what a line keeps for gaps makes a steady hand softer."""
MOST_MOVED = 0.01
"""Of one direction's frames: the playout became deeper or shallower. The delay that stiffness depends on kept changing."""
STIFFNESS_JND = 0.23
"""Share by which two stiffnesses differ before a hand tells them apart (Jones and Hunter 1990)."""
SOFTER, SOFTER_BRIEF = "Softer than asked for", "softer than asked"
LEAST_FELT_N = 0.05
"""Peak force below which a hand has felt nothing: about the smallest that a finger notices."""


@dataclass(frozen=True, slots=True)
class Judgement:
    """One of three, in a sentence that gives its reasons; brief: the same in a line of a list, "" where there is no other."""

    name: Literal["passive", "stable", "felt as intended"]
    tone: Tone
    sentence: str
    brief: str = ""


def judgements(summary: Summary, tank_j: float | None = None) -> tuple[Judgement, Judgement, Judgement]:
    """tank_j: what the lines may lend (settings), None if not known."""
    return passive(summary, tank_j), stable(summary), felt(summary)


def succeeded(summary: Summary) -> bool:
    """Return what exit code 0 stands for: passive and stable as far as every end goes, and nobody's device ended in a fault.

    Not how it felt: a force at its limit is no failure of the session. What clients of others say of themselves fails nothing.
    """
    users = people(summary)
    in_fault = any(user.get("state") == "fault" and not user.get("claimed") for user in users)
    fails = {"bad"} if any(user.get("claimed") for user in users) else {"bad", "warn"}
    return not in_fault and not fails & {passive(summary).tone, stable(summary).tone}


def why_not(summary: Summary) -> str:
    """Return the reason why a run has not `succeeded`, in sentences."""
    faults = [f"{name_of(user)} ended in a fault." for user in people(summary) if user.get("state") == "fault"]
    parts = (passive(summary), stable(summary))
    return " ".join([*(part.sentence for part in parts if part.tone != "good"), *faults])


def came(summary: Summary) -> bool:
    """Return whether anybody was there: an empty room has nothing to be judged."""
    return any(True for _ in _held(people(summary)))


# Passive ---------------------------------------------------------------------------------------------------------------


def passive_of(rows: list[Row], tank_j: float) -> bool | None:
    """`passive` of a summary with these people, by the margins that the ends told: None where an end did not tell."""
    held = list(_held(rows))
    bounds = {key: -(2.0 if key == "line_margin_j" else 1.0) * tank_j - ROUNDING_J for key in MARGINS}
    bounds["device_margin_j"] = -ROUNDING_J
    told = [(dig(row, "energy", key), bounds[key]) for row in held for key in _measured(row)]
    if any(value is not None and not (is_number(value) and value >= bound) for value, bound in told):
        return False
    return None if any(_untold(row) for row in held) or not held else True


def _measured(row: Row) -> tuple[str, ...]:
    """The margins that a verdict may rest on: of somebody else's client, those that the server's end took part in."""
    ours = ("up_margin_j", "line_margin_j")
    return ours if row.get("claimed") else (*ours, "down_margin_j", "device_margin_j")


def _claimed_margins(users: list[Row], tank_j: float) -> list[str]:
    """Return what clients of others say against themselves."""
    bounds = (("down_margin_j", "its line down", -tank_j), ("device_margin_j", "its device", 0.0))
    return [
        f"the client of {name_of(row)} says that {words} gave out {energy(-value)} too much"
        for row in seat_sessions(users)
        if row.get("claimed")
        for key, words, bound in bounds
        if is_number(value := dig(row, "energy", key)) and value < bound - ROUNDING_J
    ]


def passive(summary: Summary, tank_j: float | None = None) -> Judgement:
    """Judge whether no line, and no device port, ever gave out more energy than had come in."""
    users, said = people(summary), summary.get("passive")
    worst, device = worst_margin(users), _worst_device(users)
    if said is False:
        return Judgement("passive", "bad", *_not_passive(users, worst, device, tank_j))
    if claims := _claimed_margins(users, tank_j or 0.0):
        text = f"Passive as far as this end measured, but {'; '.join(claims)}."
        return Judgement("passive", "warn", text, f"{claims[0]}{f' and {len(claims) - 1} more' if claims[1:] else ''}")
    missing: dict[str, list[str]] = {}
    for row in _held(users):
        for text in _untold(row):
            missing.setdefault(text, []).append(name_of(row))
    if missing or said is not True or worst is None:
        told = [f"{text} of {_some(dict.fromkeys(names))}" for text, names in missing.items()]
        why = "; ".join(told) or "no end told its energy margin"
        return Judgement("passive", "warn", f"Whether the run was passive is not known: {why}.")
    lent = f" The tank may lend {energy(tank_j)}." if tank_j else ""
    port = "no device's motors either" if device else "nor, say the clients, any motors"
    port += _least_reserves(users)
    margin_j, ledger, who = worst
    if margin_j < -ROUNDING_J:
        lender = "its tank" if tank_j else "its passivity controller, E(0),"
        text = f"Passive: the {ledger} of {who} was {energy(-margin_j)} ahead at most, which {lender} had lent; {port}.{lent}"
    else:
        text = f"Passive: no line ever gave out more energy than had been put in, {port}.{lent}"
    return Judgement("passive", "good", text)


def _least_reserves(users: list[Row]) -> str:
    """Return the least energy reserves after the first second, "" where no end told."""
    line, device = least_reserve(users, "line_reserve_j"), least_reserve(users, "device_reserve_j")
    ours = device if not any(row.get("claimed") for row in users) else None
    told = [f"{energy(each[0])} {where}" for each, where in ((line, "in a whole line"), (ours, "at a device")) if each]
    return f"; least reserve after the first second {', '.join(told)}" if told else ""


def _not_passive(
    users: list[Row], worst: tuple[float, str, str] | None, device: tuple[float, str] | None, tank_j: float | None
) -> tuple[str, str]:
    """Sentence and brief."""
    found, brief = [], []
    if worst and overdrawn(users, tank_j or 0.0):
        lent = f" The tank may lend {energy(tank_j)}." if tank_j else ""
        found.append(f"the {worst[1]} of {worst[2]} gave out {energy(-worst[0])} more than had been put in.{lent}")
        brief.append(f"{worst[1]} of {worst[2]} {energy(worst[0])}")
    if device and device[0] < -ROUNDING_J:
        leak = "" if (leak_j := _leak_of(users, device[1])) is None else f", {energy(leak_j)} at most,"
        found.append(
            f"the device end of {device[1]} gave out more energy{leak} than came in and the device's own damping takes "
            f"(margin {energy(device[0])})."
        )
        brief.append(f"device of {device[1]} {energy(device[0])}")
    if found:
        return f"Not passive: {' '.join(found)}", f"not passive: {', '.join(brief)}"
    least = f"the least that is one is {energy(worst[0])} ({worst[1]} of {worst[2]})" if worst else "none is one"
    why = "not passive as far as can be told: an energy margin is no number"
    return f"Not passive as far as can be told: an end told an energy margin that is no number; {least}.", why


def _worst_device(users: list[Row]) -> tuple[float, str] | None:
    """(margin [J], whose), of the device ports whose margin is a number."""
    found = [
        (float(value), name_of(row))
        for row in seat_sessions(users)
        if not row.get("claimed") and is_number(value := dig(row, "energy", "device_margin_j"))
    ]
    return min(found, default=None)


def _leak_of(users: list[Row], name: str) -> float | None:
    leaks = [row["leak_j"] for row in seat_sessions(users) if name_of(row) == name and is_number(row.get("leak_j"))]
    return max(leaks, default=None)


def _held(users: list[Row]) -> Iterator[Row]:
    """Every sitting of which somebody was heard: a seat that nobody took has nothing to tell."""
    for row in users:
        for seat_session in (*earlier(row), row):
            empty = seat_session.get("state") is None and not dig(seat_session, "link", "received")
            if seat_session is not row or not (empty and dig(seat_session, "energy", "up_margin_j") is None):
                yield seat_session


def _untold(row: Row) -> list[str]:
    """Return what is missing of one sitting before it can be called passive, as what stands before `of <name>`."""
    margins = [dig(row, "energy", key) for key in ("up_margin_j", "down_margin_j")]
    if row.get("state") is None:
        received = dig(row, "link", "up", "received")
        return ["no account was told by the client" if received else "nothing was heard from the client"]
    missing = []
    if margins == [None, None]:
        missing.append("no energy ledger was kept on the network")
    elif None in margins:
        missing.append("the server told nothing of the line")
    if dig(row, "energy", "device_margin_j") is None:
        missing.append("nothing was told of the device port")
    return missing


def unjudged(summary: Summary) -> bool:
    """Return whether a run is of clients that told nothing of their device ports at all: an old one."""
    return all(dig(row, "energy", "device_margin_j") is None for row in _held(people(summary)))


# Stable ----------------------------------------------------------------------------------------------------------------


def stable(summary: Summary) -> Judgement:
    """Judge whether nothing diverged and no force oscillated at a hand."""
    users, said = people(summary), summary.get("diverged")
    shaking = _named(row for row in seat_sessions(users) if row.get("oscillates") is True and not row.get("claimed"))
    found, brief = [], []
    if said is True:
        why = [f"{name_of(user)}: {user['reason']}" for user in users if user.get("reason") and not user.get("claimed")]
        where = vector(dig(summary, "object", "position_m"), scale=1e3)
        found.append(f"Diverged. {'; '.join(why) or f'The object left the workspace, it was last at {where} mm'}")
        brief.append(f"diverged{f' ({why[0]})' if why else ''}")
    if shaking:
        begins = "The" if found else "Not stable: the"
        found.append(f"{begins} force on {_some(shaking)} oscillated, and was let go")
        brief.append(f"oscillated ({_some(shaking)})")
    if found:
        return Judgement("stable", "bad", f"{'. '.join(found)}.", ", ".join(brief))
    if said is not False:
        return Judgement(
            "stable", "warn", "Whether the run was stable is not known: no end told whether anything diverged."
        )
    shaking = _named(row for row in seat_sessions(users) if row.get("oscillates") is True)
    diverged = _named(row for row in seat_sessions(users) if dig(row, "claimed", "diverged") is True)
    if shaking or diverged:
        claims = [f"{what} of {_some(who)}" for what, who in (("the force", shaking), ("the hand", diverged)) if who]
        text = f"Stable as far as this end measured, but clients say that they were not: {', '.join(claims)}."
        return Judgement("stable", "warn", text, f"not stable, says the client of {_some([*shaking, *diverged])}")
    unknown = _named(row for row in _held(users) if not isinstance(row.get("oscillates"), bool))
    if unknown or not users:
        return Judgement(
            "stable", "warn",
            f"Whether the run was stable is not known: nothing diverged; whether a force oscillated was not told of "
            f"{_some(unknown) or 'anybody'}.",
        )  # fmt: skip
    let_go = _named(row for row in seat_sessions(users) if row.get("let_go"))
    if let_go:
        text = f"Not known to be stable: the force on {_some(let_go)} was let go, at its limit or for want of energy."
        return Judgement("stable", "warn", text, f"let go ({_some(let_go)})")
    return Judgement("stable", "good", "Stable: nothing diverged, and no force oscillated at a hand.")


# Felt as intended ------------------------------------------------------------------------------------------------------


def felt(summary: Summary) -> Judgement:
    """Judge whether hands felt what the force law and the network's frames made, and nothing that took their place."""
    held = list(_held(people(summary)))
    reasons = list(dict.fromkeys(_worst_reasons(held)))
    if stable(summary).tone == "bad":
        reasons.insert(0, "the session was not stable")
    if reasons:
        more = f" (and {len(reasons) - 1} more reasons)" if len(reasons) > 1 else ""
        brief = f"not felt as intended: {reasons[0]}{more}"
        return Judgement("felt as intended", "warn", f"Not felt as intended: {'; '.join(reasons)}.", brief)
    unknown = list(dict.fromkeys(name_of(row) for row in held if not is_number(row.get("at_limit"))))
    if unknown or not held:
        text = f"Whether it felt as intended is not known: limits on the force were not told of {_some(unknown) or 'anybody'}."
        return Judgement("felt as intended", "warn", text)
    if not any((_value(row, "peak_force_n") or 0.0) >= LEAST_FELT_N for row in held):
        return Judgement("felt as intended", "warn", "Nothing was felt: no hand met a force.")
    if softer := _softer(held):
        return Judgement("felt as intended", "warn", f"{SOFTER}: {softer}.", SOFTER_BRIEF)
    return Judgement("felt as intended", "good", f"Felt as intended{_stiffness(held)}.")


def _softer(held: list[Row]) -> str:
    """Whose stiffness at rest, measured or else predicted, a hand tells from the one asked for; the worst of them."""
    found = []
    for row in held:
        measured, predicted = _value(row, "felt_stiffness_npm"), _value(row, "predicted_stiffness_npm")
        asked, rest = _value(row, "asked_stiffness_npm"), predicted if measured is None else measured
        if asked and rest is not None and rest < (1.0 - STIFFNESS_JND) * asked:
            how = "predicted, not measured" if measured is None else "as measured"
            found.append((rest / asked, f"{rest:.0f} N/m at rest of {asked:.0f} N/m asked for, {how}", name_of(row)))
    if not found:
        return ""
    _, worst, name = min(found)
    return worst if len({text for _, text, _ in found}) == 1 and len(found) == len(held) else f"{worst} ({name})"


def _stiffness(held: list[Row]) -> str:
    found = [value for row in held if (value := _value(row, "predicted_stiffness_npm")) is not None]
    if not found:
        why = next((f" ({name_of(row)}: {row['not_predicted']})" for row in held if row.get("not_predicted")), "")
        return f"; how stiff at rest is neither measured nor predicted{why}" if why else ""
    low, high = min(found), max(found)
    span = f"{low:.0f}" if f"{low:.0f}" == f"{high:.0f}" else f"{low:.0f} to {high:.0f}"
    measured = all(_value(row, "felt_stiffness_npm") is not None for row in held)
    return f"; {span} N/m at rest, {'felt as predicted' if measured else 'predicted, not measured'}"


def _worst_reasons(held: list[Row]) -> Iterator[str]:
    """Each reason once, with the person whom it is worst of, and how many others there are."""
    for share_of, bound, words in _SHARES:
        found = [(share, row) for row in held if (share := share_of(row)) is not None and share > bound]
        if found:
            share, row = max(found, key=lambda each: each[0])
            others = f" (and more than {100.0 * bound:g} % with {len(found) - 1} more)" if len(found) > 1 else ""
            yield words.format(share=_percent(share), name=name_of(row), direction=_replaced(row)[1]) + others
    for row in held:
        if row.get("state") in ("fault", "degraded"):
            yield f"{name_of(row)} ended without force"
        measured, predicted = _value(row, "felt_stiffness_npm"), _value(row, "predicted_stiffness_npm")
        if measured is not None and predicted is not None and abs(measured - predicted) > STIFFNESS_JND * predicted:
            yield f"{name_of(row)} felt {measured:.0f} N/m at rest, where {predicted:.0f} N/m is predicted"


def not_predicted(row: Row) -> str:
    """Why the stiffness that the linear line predicts does not hold of this person's run; "" where it may."""
    limited, controlled, moved = _value(row, "at_limit") or 0.0, _value(row, "controlled") or 0.0, _moved(row)
    if row.get("oscillates") is True:
        return "the force oscillated"
    if row.get("state") in ("fault", "degraded"):
        return f"it ended in {row['state']}"
    if limited > MOST_LIMITED:
        return f"the force was at a limit in {_percent(limited)} of the ticks"
    if controlled > MOST_CONTROLLED:
        return f"the device port changed what is felt in {_percent(controlled)} of the ticks"
    if _scattered(row) > MOST_REPLACED_AT_REST:
        return f"{_percent(_replaced(row)[0])} of the frames {_replaced(row)[1]} it were replaced"
    if moved > MOST_MOVED:
        return f"the playout's depth changed at {_percent(moved)} of the frames"
    return ""


def _value(row: Row, key: str) -> float | None:
    return float(row[key]) if is_number(row.get(key)) else None


def _replaced(row: Row) -> tuple[float, str]:
    """Share of the frames of a direction that were not there in time, of the direction where it is larger."""
    return max(
        (_share(row, direction, "concealed"), "from" if direction == "up" else "to") for direction in ("up", "down")
    )


def _scattered(row: Row) -> float:
    """Share of the replaced frames that were not one gap: a delay that grew once leaves one, and the line is as before."""
    return max(
        _share(row, direction, "concealed") - _share(row, direction, "longest_gap") for direction in ("up", "down")
    )


def _moved(row: Row) -> float:
    return max(_share(row, direction, "repeated") + _share(row, direction, "skipped") for direction in ("up", "down"))


def _share(row: Row, direction: str, key: str) -> float:
    """Of the frames that were sent in a direction; 0 where that is not known, or nothing is played out."""
    count, sent = dig(row, "playout", direction, key), dig(row, "link", direction, "sent")
    return min(1.0, count / sent) if is_number(count) and is_number(sent) and sent > 0 else 0.0


_SHARES: tuple[tuple[Callable[[Row], float | None], float, str], ...] = (
    (lambda row: _value(row, "at_limit"), MOST_LIMITED, "a limit of {name}'s device held the force in {share} of the ticks"),
    (lambda row: _value(row, "controlled"), MOST_CONTROLLED, "{name}'s device port changed what is felt in {share} of ticks"),
    (lambda row: _replaced(row)[0], MOST_REPLACED, "{share} of the frames {direction} {name} were missing and replaced"),
)  # fmt: skip
"""How to read a share of a person, what it may be, and the reason that it gives where it is more."""


def _percent(share: float) -> str:
    return f"{number(100.0 * share, digits=0 if share >= 0.1 else 1)} %"


def _named(rows: Iterable[Row]) -> list[str]:
    """Each name once."""
    return list(dict.fromkeys(map(name_of, rows)))


def _some(names: Iterable[str]) -> str:
    """A few of them, and how many more there are."""
    names = list(names)
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
