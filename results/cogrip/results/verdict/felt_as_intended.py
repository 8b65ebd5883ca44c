"""The third judgement of a run: limits, replaced frames and softness that a hand feels in place of what was asked for."""

from collections.abc import Callable, Iterator

from cogrip.protocol.settings.object_kinds import ObjectKind, kind_of
from cogrip.results.reading.summary_values import FORCELESS, Summary, dig, is_number, name_of, number, people
from cogrip.results.verdict.judgement import Judgement, Tone, UserValues, names_of, occupied, some

MOST_LIMITED = 0.01
"""Largest fraction of live ticks in which a limit of the device held the force, and the hand felt it: 10 ms a second."""
MOST_CONTROLLED = 0.05
"""Largest fraction of live ticks in which the device port changed the force or reduced the impedance."""
MOST_REPLACED = 0.05
"""Largest fraction of a direction's frames that were concealed. Telehaptics bears losses of 10 % (docs/decisions/0010)."""
MOST_REPLACED_AT_REST = 0.001
"""Largest fraction of frames concealed beside the longest gap, where a line whose credit did not pay for all is predicted."""
MOST_LENT = 0.4
"""Fraction of the credit that a line has lent at most where the credit paid: compensation spends no more than half of it."""
MOST_MOVED = 0.01
"""Largest fraction of a direction's frames at which the playout delay changed. Felt stiffness depends on that delay."""
GROWN = 0.95
"""Least fraction of the stiffness to which a spring goes that counts as reached: under load it may stay behind."""
MOST_SHAKEN_N = 0.15
"""Largest rms of a force above 12 Hz that may last for half a second.

Hands detect less (`cogrip.client.safety.shaking` has the sources), so that the number is told in any case; this is 6 % of
2.5 N, of which a hand tells 7 % apart (Pang, Tan and Durlach 1991).
"""
STIFFNESS_JND = 0.23
"""Fraction by which two stiffnesses differ before a hand tells them apart (Jones and Hunter 1990)."""
SOFTER, SOFTER_BRIEF = "Softer than asked for", "softer than asked"
LEAST_FELT_N = 0.05
"""Peak force below which a hand has felt nothing: about the smallest that a finger notices."""
LEAST_FELT_NM = 0.02 * LEAST_FELT_N
"""Peak torque below which a hand has felt nothing: that force at a handle's radius."""

_LEAST_FELT = (("peak_force_n", LEAST_FELT_N), ("peak_torque_nm", LEAST_FELT_NM), ("peak_grip_n", LEAST_FELT_N))


def felt_as_intended(summary: Summary, stable: bool) -> Judgement:
    """Judge whether hands felt what the force law and the network's frames made, and nothing that took their place."""
    held = list(occupied(people(summary)))
    reasons = list(dict.fromkeys(_worst_reasons(held)))
    if limited := _taken(summary):
        reasons.append(limited)
    if not stable:
        reasons.insert(0, "the session was not stable")
    tone: Tone = "warn"
    brief = ""
    if reasons:
        more = f" (and {len(reasons) - 1} more reasons)" if len(reasons) > 1 else ""
        text, brief = f"Not felt as intended: {'; '.join(reasons)}.", f"not felt as intended: {reasons[0]}{more}"
    elif (unknown := names_of(row for row in held if not is_number(row.get("at_limit")))) or not held:
        whom = some(unknown) or "anybody"
        text = f"Whether it felt as intended is not known: limits on the force were not reported of {whom}."
    elif not any((_value(row, key) or 0.0) >= least for row in held for key, least in _LEAST_FELT):
        text = "Nothing was felt: no hand met a force."
    elif untouched := _untouched(summary, held):
        text = untouched
    elif copied := _copied(summary):
        text = copied
    elif softer := _softer(held):
        text, brief = f"{SOFTER}: {softer}.", SOFTER_BRIEF
    elif untold := _unknown_stiffness(held):
        text = f"How stiff it felt is not known: {untold}."
    else:
        tone, text = "good", f"Felt as intended{_stiffness(held)}{_shaken(held)}."
    return Judgement("felt as intended", tone, text, brief)


def _untouched(summary: Summary, held: list[UserValues]) -> str:
    """Return whose tools met no body of their scene, where nobody's did or there was a task; "" where that is nobody's.

    What is felt then is the line alone. A tool that is tied to something holds it without contact; and contact that a client
    renders itself is not the server's to see.
    """
    tools = dig(summary, "server", "scene", "tools")
    if not isinstance(tools, list):
        return ""
    touched = {tool["name"]: tool["contact_s"] for tool in tools if tool.get("tied") is False}
    seen = [row for row in held if name_of(row) in touched and not row.get("local")]
    missed = names_of(row for row in seen if not touched[name_of(row)])
    if not missed or (len(missed) < len(seen) and not isinstance(summary.get("task"), dict)):
        return ""
    return f"Nothing was touched by the tool of {some(missed)}: what was felt of the scene was the line alone."


def _copied(summary: Summary) -> str:
    """Return why it is not known how a scene felt of which each hand had a copy; "" where none had."""
    if not isinstance(summary.get("gates"), dict) or not isinstance(dig(summary, "server", "scene"), dict):
        return ""
    return "How the scene felt is not known: each hand felt a copy of its own, where bodies may slip that the server's hold."


def _unknown_stiffness(held: list[UserValues]) -> str:
    """Return whose stiffness was asked for, and is neither measured nor predicted, and why; "" where there is nobody."""
    unknown = [row for row in held if not _rested(row)]
    gripping = names_of(row for row in held if (_value(row, "peak_grip_n") or 0.0) >= LEAST_FELT_N)
    if not unknown and gripping:
        return (
            f"the gripper's, with {some(gripping)}, is not measured, and a run does not know what fingers held; "
            "`cogrip advise` says how stiff the scene's object is felt between them, and their line, at the settings' delay"
        )
    if not unknown:
        return ""
    if resting := names_of(row for row in unknown if _contact(row).scene):
        return f"{some(resting)} rested on no fixed shape that a client renders"
    why = next((f" ({row['not_predicted']})" for row in unknown if row.get("not_predicted")), "")
    return f"that of {some(names_of(unknown))} was neither measured at rest nor can be predicted{why}"


def _rested(row: UserValues) -> bool:
    """Return whether a stiffness was measured, or is not asked for."""
    return any(_value(row, key) is not None for key in ("felt_stiffness_npm", "predicted_stiffness_npm")) or not _value(
        row, "asked_stiffness_npm"
    )


def _shaken(held: list[UserValues]) -> str:
    """Return the largest shaking that lasted, "" where it is less than anybody detects."""
    most_n = max((_value(row, "shake_n") or 0.0 for row in held), default=0.0)
    return f"; the force shook by {number(most_n, digits=2)} N rms above 12 Hz at most" if most_n >= 0.01 else ""


def _taken(summary: Summary) -> str:
    """Return how often a scene's energy limiter took from what hands felt, "" if that was rare."""
    frames, due = dig(summary, "server", "energy_limiter", "limited_frames"), dig(summary, "server", "ticks", "due")
    if not (is_number(frames) and is_number(due) and frames > MOST_LIMITED * due):
        return ""
    return f"the scene's energy limiter acted in {_percent(frames / due)} of the frames"


def _softer(held: list[UserValues]) -> str:
    """Return whose stiffness at rest, measured or else predicted, a hand tells from the one asked for; the worst of them."""
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


def _stiffness(held: list[UserValues]) -> str:
    """Return the span of the predicted stiffnesses at rest in words, or why none is predicted."""
    found = [value for row in held if (value := _value(row, "predicted_stiffness_npm")) is not None]
    felt = [value for row in held if (value := _value(row, "felt_stiffness_npm")) is not None]
    if felt and not found:  # what is pressed on in a scene is predicted of nobody: it may move
        return f"; {' to '.join(dict.fromkeys(f'{value:.0f}' for value in (min(felt), max(felt))))} N/m at rest, as measured"
    if not found:
        return "; no stiffness is asked for here, so none is judged"
    measured = all(_value(row, "felt_stiffness_npm") is not None for row in held)
    told = felt if measured else found  # what was felt is what is told, wherever it was measured
    span = " to ".join(dict.fromkeys(f"{value:.0f}" for value in (min(told), max(told))))
    return f"; {span} N/m at rest, {'as measured and predicted' if measured else 'predicted, not measured'}"


def _worst_reasons(held: list[UserValues]) -> Iterator[str]:
    """Yield each reason once, with the person whom it is worst of, and how many others there are."""
    for share_of, bound, words in _SHARES:
        found = [(share, row) for row in held if (share := share_of(row)) is not None and share > bound]
        if found:
            share, row = max(found, key=lambda each: each[0])
            others = f" (and more than {100.0 * bound:g} % with {len(found) - 1} more)" if len(found) > 1 else ""
            yield words.format(share=_percent(share), name=name_of(row), direction=_replaced(row)[1]) + others
    shaken = [(shake, row) for row in held if (shake := _value(row, "shake_n")) is not None and shake > MOST_SHAKEN_N]
    if shaken:
        shake, row = max(shaken, key=lambda each: each[0])
        others = f" (and that on {len(shaken) - 1} more)" if len(shaken) > 1 else ""
        yield f"the force on {name_of(row)}{others} shook by {number(shake, digits=2)} N rms above 12 Hz for half a second"
    for row in held:
        if row.get("state") in FORCELESS:
            yield f"{name_of(row)} ended without force"
        measured, predicted = _value(row, "felt_stiffness_npm"), _value(row, "predicted_stiffness_npm")
        if measured is not None and predicted is not None and abs(measured - predicted) > STIFFNESS_JND * predicted:
            yield f"{name_of(row)} felt {measured:.0f} N/m at rest, where {predicted:.0f} N/m is predicted"


def not_predicted(row: UserValues, credit_j: float, goal_npm: float | None = None) -> str:
    """Return why the stiffness that the linear line predicts does not hold of this person's run; "" where it may.

    credit_j: what each direction of the line may lend. goal_npm: stiffness to which the server's spring was to go, where that
    is known; else at least what is predicted, as no line in series makes a spring stiffer.
    """
    margins = [dig(row, "energy", key) for key in ("up_margin_j", "down_margin_j")]
    paid = credit_j > 0.0 and all(not is_number(each) or each > -MOST_LENT * credit_j for each in margins)
    limited, controlled = _value(row, "at_limit") or 0.0, _value(row, "controlled") or 0.0
    paths = ("up", "down")
    moved = max(_share(row, path, "repeated") + _share(row, path, "skipped") for path in paths)
    # Replaced frames that were not one gap: a delay that grew once leaves one, and the line is as before.
    scattered = max(_share(row, path, "concealed") - _share(row, path, "longest_gap") for path in paths)
    if row.get("oscillates") is True:
        return "the force oscillated"
    if row.get("state") in FORCELESS:
        return f"it ended in {row['state']}"
    if limited > MOST_LIMITED:
        return f"the force was at a limit in {_percent(limited)} of the ticks"
    if controlled > MOST_CONTROLLED:
        return f"the device port changed what is felt in {_percent(controlled)} of the ticks"
    asked, rendered = dig(row, "hand", "stiffness_npm"), _value(row, "rendered_npm")
    if is_number(asked) and rendered is not None and rendered < GROWN * asked:
        return f"its spring has come to {rendered:.0f} of the {asked:.0f} N/m that were set: more was not paid for"
    if row.get("local"):
        return ""  # what is pressed on is not behind the line
    scale = dig(row, "hand", "force_scale")
    felt = (_value(row, "predicted_stiffness_npm") or 0.0) / (scale if is_number(scale) else 1.0)
    goal_npm = goal_npm or felt
    if rendered is not None and 0.0 < rendered < GROWN * goal_npm:
        return f"its spring has come to {rendered:.0f} of {goal_npm:.0f} N/m: under load, more was not paid for"
    if scattered > (MOST_REPLACED if paid else MOST_REPLACED_AT_REST):
        return f"{_percent(_replaced(row)[0])} of the frames {_replaced(row)[1]} it were replaced"
    if moved > MOST_MOVED:
        return f"the playout's depth changed at {_percent(moved)} of the frames"
    return ""


def _contact(row: UserValues) -> ObjectKind:
    """Return the properties of the object with which a client rendered contact itself; of an unknown one without that."""
    return kind_of(str(row.get("local", "")))


def _value(row: UserValues, key: str) -> float | None:
    return float(row[key]) if is_number(row.get(key)) else None


def _replaced(row: UserValues) -> tuple[float, str]:
    """Return the share of frames that were not there in time, `from` or `to` the person, whichever is larger; none of a wall
    that the client renders itself, which no frame carries."""
    if _contact(row).fixed:
        return 0.0, "to"
    return max((_share(row, "up", "concealed"), "from"), (_share(row, "down", "concealed"), "to"))


def _share(row: UserValues, direction: str, key: str) -> float:
    """Return a count's share of the frames that were due in a direction; 0 where that is not known, or nothing is played out.

    Due is what was sent; where the other end was gone for a while, and sent nothing, what was played or replaced.
    """
    count, sent = dig(row, "playout", direction, key), dig(row, "link", direction, "sent")
    if not is_number(count) or not is_number(sent) or sent <= 0:
        return 0.0
    applied, replaced = dig(row, "link", direction, "applied"), dig(row, "playout", direction, "concealed")
    due = max(sent, applied + replaced) if is_number(applied) and is_number(replaced) else sent
    return float(min(1.0, count / due))


# Share of a person, its bound, and the reason that it gives where it is more.
_SHARES: tuple[tuple[Callable[[UserValues], float | None], float, str], ...] = (
    (lambda row: _value(row, "at_limit"), MOST_LIMITED, "a limit of {name}'s device held the force in {share} of the ticks"),
    (lambda row: _value(row, "controlled"), MOST_CONTROLLED, "{name}'s device port changed what is felt in {share} of ticks"),
    (lambda row: _replaced(row)[0], MOST_REPLACED, "{share} of the frames {direction} {name} were missing and replaced"),
)  # fmt: skip


def _percent(share: float) -> str:
    return f"{number(100.0 * share, digits=0 if share >= 0.1 else 1)} %"
