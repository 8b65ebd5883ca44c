"""Three judgements of a run, for the whole chain from hand to object, devices included: passive, stable, felt as intended.

Each is good only where every end reported what it takes to know: missing values warn. The rules are the same wherever a run is
judged (`lab`, `demo`, `join`, `serve`, reports, `runs`, `compare`, exit codes); docs/verdict.md lists them with their bounds.
"""

from __future__ import annotations

from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.coupling_kinds import UNLENT_MJ
from cogrip.results.reading.summary_values import (
    ROUNDING_J,
    Summary,
    dig,
    energy,
    is_number,
    least_reserve,
    ledgers,
    name_of,
    people,
    seat_sessions,
    worst_margin,
)
from cogrip.results.verdict.felt_as_intended import felt_as_intended
from cogrip.results.verdict.incidents import incidents, is_unstable, why_unstable
from cogrip.results.verdict.judgement import Judgement, UserValues, names_of, occupied, some


def judgements(summary: Summary) -> tuple[Judgement, Judgement, Judgement]:
    """Return the three judgements."""
    return passive(summary), stable(summary), felt(summary)


def succeeded(summary: Summary) -> bool:
    """Return what exit code 0 stands for: passive and stable as far as every end goes, and nobody's device ended in a fault.

    A force at its limit, and what left the workspace, are no failure of the session; what clients of others say of themselves
    fails nothing.
    """
    users = people(summary)
    in_fault = any(user.get("state") == "fault" and not user.get("claimed") for user in users)
    fails = {"bad"} if any(user.get("claimed") for user in users) else {"bad", "warn"}
    return not in_fault and not fails & {passive(summary).tone, _stability(summary).tone}


def why_not(summary: Summary) -> str:
    """Return the reason why a run has not `succeeded`, in sentences."""
    faults = [f"{name_of(user)} ended in a fault." for user in people(summary) if user.get("state") == "fault"]
    parts = (passive(summary), _stability(summary))
    return " ".join([*(part.sentence for part in parts if part.tone != "good"), *faults])


def came(summary: Summary) -> bool:
    """Return True if anybody was there: an empty room has nothing to be judged."""
    return any(True for _ in occupied(people(summary)))


def unjudged(summary: Summary) -> bool:
    """Return True for a run none of whose clients reported anything of its device port."""
    return all(dig(row, "energy", "device_margin_j") is None for row in occupied(people(summary)))


# Passive ---------------------------------------------------------------------------------------------------------------


def passive_of(rows: list[UserValues], credit_j: float, gates: UserValues | None = None) -> bool | None:
    """Return `passive` of a summary with these people, by the reported margins; None where an end reported none.

    gates: of the summary; None where the scheme has none
    """
    if _gates_leaked(gates):
        return False
    held = list(occupied(rows))
    reported = [(row, key, dig(row, "energy", key)) for row in held for key in _measured(row)]
    if any(
        value is not None and not (is_number(value) and value >= least_margin(row, key, credit_j))
        for row, key, value in reported
    ):
        return False
    return None if not held or any(_untold(row, gates) for row in held) else True


def _gates_leaked(gates: UserValues | None) -> bool:
    """Return whether recordings show that all hands together took more than their gates may give."""
    margin_j = dig(gates, "margin_j")
    return margin_j is not None and not (is_number(margin_j) and margin_j >= -float(dig(gates, "tolerance_j") or 0.0))


def least_margin(row: UserValues, key: str, credit_j: float) -> float:
    """Return the least that a person's margin may be [J]: less what its directions may have lent, and rounding.

    row: of the summary; an empty one where nothing is known of frames yet, so that anything may have been lent
    """
    paths = {"up_margin_j": ("up",), "down_margin_j": ("down",), "line_margin_j": ("up", "down")}.get(key, ())
    return -add_floats(_lent_j(row, path, credit_j) for path in paths) - ROUNDING_J


def _lent_j(row: UserValues, path: str, credit_j: float) -> float:
    """Return what a direction may have lent at most: its credit, where a wave was played in place of one that was not there.

    Where none was, nothing was lent, and what is missing was created: by a decimator that lets aliases through, for one.
    """
    filled = [dig(row, "playout", path, key) for key in ("concealed", "repeated")]
    return credit_j if any(not is_number(each) or each > 0 for each in filled) else min(credit_j, 1e-3 * UNLENT_MJ)


def _claimed_down(users: list[UserValues]) -> list[tuple[float, str, str]]:
    """Return what clients say of their lines down, as `worst_margin` tells it: no verdict rests on it, but its words do."""
    told = [(dig(row, "energy", "down_margin_j"), name_of(row)) for row in occupied(users) if row.get("claimed")]
    return [(margin_j, "line down", f"{name}, says the client") for margin_j, name in told if is_number(margin_j)] or [
        (0.0, "", "")
    ]


def _measured(row: UserValues) -> tuple[str, ...]:
    """Return the margins that a verdict may rest on: of somebody else's client, those that the server's end took part in."""
    every = ("up_margin_j", "line_margin_j", "down_margin_j", "device_margin_j")
    claimed = row.get("claimed")
    return tuple(key for key in every if not claimed or key not in (*claimed, "device_margin_j"))


def passive(summary: Summary) -> Judgement:
    """Judge whether no line gave out more than had come in and its credit, and no device port more than had come in."""
    credit_j = recorded if is_number(recorded := summary.get("credit_j")) else None
    users, said = people(summary), summary.get("passive")
    worst, device = worst_margin(users), _worst_device(users)
    gates = found if isinstance(found := summary.get("gates"), dict) else None
    lent = _budget(users, credit_j) if gates is None else _gates(gates)
    if _gates_leaked(gates):
        least = energy(dig(gates, "margin_j"))
        text = f"Not passive: all hands together took more than their gates may give (margin {least}).{lent}"
        return Judgement("passive", "bad", text, f"not passive: hands together {least}")
    if said is False:
        return Judgement("passive", "bad", *_not_passive(users, worst, device, credit_j or 0.0, lent))
    if claims := _claimed_margins(users, credit_j or 0.0):
        text = f"Passive as far as this end measured, but {'; '.join(claims)}."
        return Judgement("passive", "warn", text, f"{claims[0]}{f' and {len(claims) - 1} more' if claims[1:] else ''}")
    missing: dict[str, list[str]] = {}
    for row in occupied(users):
        for text in _untold(row, gates):
            missing.setdefault(text, []).append(name_of(row))
    if missing or said is not True or worst is None:
        reported = [f"{text} of {some(dict.fromkeys(names))}" for text, names in missing.items()]
        why = "; ".join(reported) or "no end reported its energy margin"
        return Judgement("passive", "warn", f"Whether the run was passive is not known: {why}.")
    port = "no device's motors either" if device else "nor, say the clients, any motors"
    port += _least_reserves(users, line=gates is None)
    margin_j, ledger, who = min(worst, *_claimed_down(users))
    if gates is not None:
        text = f"Passive: no hand got more than it had put in, was given, and its gate may lend, {port}.{lent}"
    elif margin_j < -ROUNDING_J:
        most = f"by {energy(-margin_j)} at most ({ledger} of {who}), within what a line may lend"
        text = f"Passive: no line gave out more energy than had been put in but {most}; {port}.{lent}"
    else:
        text = f"Passive: no line ever gave out more energy than had been put in, {port}.{lent}"
    return Judgement("passive", "good", text)


def _budget(users: list[UserValues], credit_j: float | None) -> str:
    """Return what a person may be given beyond what came in: by the lines, and by the device's motors."""
    lent = f"{energy(credit_j)} lent by the line in each direction" if credit_j else "nothing lent by the line"
    found = [float(value) for row in seat_sessions(users) if is_number(value := dig(row, "energy", "budget_j"))]
    if not found:
        return f" The credit of each direction is {energy(credit_j)}." if credit_j else ""
    span = " to ".join(dict.fromkeys(energy(value) for value in (min(found), max(found))))
    return f" A person's energy budget is {span}, with {lent}."


def _gates(gates: UserValues) -> str:
    """Return what all hands together took, of what their gates may give."""
    taken_j, budget_j = dig(gates, "taken_j"), dig(gates, "budget_j")
    if not isinstance(taken_j, dict) or not is_number(dig(gates, "margin_j")):
        return f" Together the gates may give {energy(budget_j)}, and a refill at rest."
    each = ", ".join(f"{name} {energy(value)}" for name, value in taken_j.items())
    spare = f"at least {energy(max(0.0, gates['margin_j']))} was left at all times"
    shown = f" Together the gates might give {energy(budget_j)}, and {spare}, by the recorded forces and places"
    return f"{shown}; most taken: {each}."


def _claimed_margins(users: list[UserValues], credit_j: float) -> list[str]:
    """Return what clients of others say against themselves."""
    return [
        f"the client of {name_of(row)} says that {words} gave out {energy(-value)} too much"
        for row in seat_sessions(users)
        if row.get("claimed")
        for key, words in (("down_margin_j", "its line down"), ("device_margin_j", "its device"))
        if is_number(value := dig(row, "energy", key)) and value < least_margin(row, key, credit_j)
    ]


def _least_reserves(users: list[UserValues], line: bool) -> str:
    """Return the least energy reserves after the first second, "" where no end reported it. line: whether lines have one"""
    whole, device = least_reserve(users, "line_reserve_j"), least_reserve(users, "device_reserve_j")
    ours = device if not any(row.get("claimed") for row in users) else None
    reported = [
        f"{energy(each[0])} {where}"
        for each, where in ((whole if line else None, "in a whole line"), (ours, "at a device"))
        if each
    ]
    return f"; least reserve after the first second {', '.join(reported)}" if reported else ""


def _not_passive(
    users: list[UserValues],
    worst: tuple[float, str, str] | None,
    device: tuple[float, str] | None,
    credit_j: float,
    lent: str,
) -> tuple[str, str]:
    """Return the sentence, and the brief one."""
    found, brief = [], []
    if worst and any(
        is_number(value := dig(row, "energy", key)) and value < least_margin(row, key, credit_j)
        for row in seat_sessions(users)
        for key in ledgers(row)
    ):
        whole = credit_j > 0.0 and -worst[0] <= credit_j
        why = ", and no frame was missing there in whose place it could be lent" if whole else ""
        found.append(f"the {worst[1]} of {worst[2]} gave out {energy(-worst[0])} more than had been put in{why}.{lent}")
        brief.append(f"{worst[1]} of {worst[2]} {energy(worst[0])}")
    if device and device[0] < -ROUNDING_J:
        whose = [row for row in seat_sessions(users) if name_of(row) == device[1]]
        leak_j = max((row["leak_j"] for row in whose if is_number(row.get("leak_j"))), default=None)
        leak = "" if leak_j is None else f", {energy(leak_j)} at most,"
        found.append(
            f"the device end of {device[1]} gave out more energy{leak} than came in and the device's own damping takes "
            f"(margin {energy(device[0])})."
        )
        brief.append(f"device of {device[1]} {energy(device[0])}")
    if found:
        return f"Not passive: {' '.join(found)}", f"not passive: {', '.join(brief)}"
    least = f"the least that is one is {energy(worst[0])} ({worst[1]} of {worst[2]})" if worst else "none is one"
    why = "not passive as far as can be told: an energy margin is no number"
    return f"Not passive as far as can be told: an end reported an energy margin that is no number; {least}.", why


def _worst_device(users: list[UserValues]) -> tuple[float, str] | None:
    """Return (margin [J], whose), of the device ports whose margin is a number."""
    found = [
        (float(value), name_of(row))
        for row in seat_sessions(users)
        if not row.get("claimed") and is_number(value := dig(row, "energy", "device_margin_j"))
    ]
    return min(found, default=None)


def _untold(row: UserValues, gates: UserValues | None = None) -> list[str]:
    """Return what is missing of a seat session before it can be called passive, in words to stand before `of <name>`."""
    if row.get("state") is None:
        received = dig(row, "link", "up", "received")
        return ["no account was reported by the client" if received else "nothing was received from the client"]
    missing = []
    margins = [dig(row, "energy", key) for key in ("up_margin_j", "down_margin_j")]
    if margins == [None, None]:
        missing.append("no energy ledger was kept on the network")
    elif None in margins:
        missing.append("the server reported nothing of the line")
    if gates is not None and row.get("claimed") and not is_number(gates.get("margin_j")):
        missing.append("no recording shows the work of the hand")
    if dig(row, "energy", "device_margin_j") is None:
        missing.append("nothing was reported of the device port")
    return missing


# Stable ----------------------------------------------------------------------------------------------------------------


def stable(summary: Summary) -> Judgement:
    """Judge whether nothing was unstable and no force oscillated at a hand; warn of what saturated or left the workspace."""
    judged, found = _stability(summary), incidents(summary)
    if not found:
        return judged
    texts, brief = "; ".join(words for words, _ in found), ", ".join(short for _, short in found)
    if judged.tone == "good":
        return Judgement("stable", "warn", f"Stable, but {texts}.", brief)
    also = f"{judged.sentence} {texts[0].upper()}{texts[1:]}."
    return Judgement("stable", judged.tone, also, judged.brief and f"{judged.brief}, {brief}")


def _stability(summary: Summary) -> Judgement:
    """Judge stability alone, whatever saturated or left."""
    users, said = people(summary), is_unstable(summary)
    sessions = seat_sessions(users)
    shaking = [row for row in sessions if row.get("oscillates") is True]
    ours = names_of(row for row in shaking if not row.get("claimed"))
    found, brief = [], []
    if said is True:
        why = why_unstable(summary)
        found.append(f"Not stable: {'; '.join(why)}")
        brief.append(f"unstable ({why[0]})")
    if ours:
        begins = "The" if found else "Not stable: the"
        found.append(f"{begins} force on {some(ours)} oscillated, and was let go")
        brief.append(f"oscillated ({some(ours)})")
    if found:
        return Judgement("stable", "bad", f"{'. '.join(found)}.", ", ".join(brief))
    not_known = "Whether the run was stable is not known:"
    if said is not False:
        return Judgement("stable", "warn", f"{not_known} no end reported whether anything was unstable.")
    unstable = names_of(row for row in sessions if dig(row, "claimed", "unstable") is True)
    if theirs := [(what, who) for what, who in (("the force", names_of(shaking)), ("the hand", unstable)) if who]:
        claims = ", ".join(f"{what} of {some(who)}" for what, who in theirs)
        text = f"Stable as far as this end measured, but clients say that they were not: {claims}."
        return Judgement(
            "stable", "warn", text, f"not stable, says the client of {some([*names_of(shaking), *unstable])}"
        )
    unknown = names_of(row for row in occupied(users) if not isinstance(row.get("oscillates"), bool))
    if unknown or not users:
        text = f"{not_known} nothing was unstable; whether a force oscillated was not reported of {some(unknown) or 'anybody'}."
        return Judgement("stable", "warn", text)
    if let_go := names_of(row for row in sessions if row.get("let_go") and row.get("saturated") is not True):
        text = f"Not known to be stable: the force on {some(let_go)} was let go, at its limit or for want of energy."
        return Judgement("stable", "warn", text, f"let go ({some(let_go)})")
    return Judgement("stable", "good", "Stable: no number grew out of bounds, and no force oscillated at a hand.")


def felt(summary: Summary) -> Judgement:
    """Judge whether it felt as intended; a session that was not stable did not."""
    return felt_as_intended(summary, stable(summary).tone != "bad")
