"""The measures of a session in a comparison, with units and formulas. Shapes and symbols are those of `SessionTrace`.

All are read alike for every method: from forces on hands, positions of hands and object, and the object's position as
reported to each person. Only `margin_mj` (the least margin of a method's wave lines) and `leak_mj` (energy that the devices'
sampled dampers gave out; with waves `created_mj` is at most this) are a method's own accounts.

Each session is judged twice. Unstable: it diverged, or oscillates. Not passive: a ledger of its lines and device ports fell
below its credit (the run's verdict), or much more energy was created than those ledgers account for (a server's step has
none). So a session may be stable and not passive: hands take what was created.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any, Literal

import numpy as np

from cogrip.analysis.feel.trace import Array, SessionTrace
from cogrip.machine.addition import add_floats, add_integers
from cogrip.results.reading.summary_values import Summary, dig, is_number, people, worst_margin
from cogrip.results.verdict.felt_as_intended import SOFTER
from cogrip.results.verdict.verdict import felt

LAST_S = 0.5  # length of the stretch at the end over which the rest is judged
SWING_N = 1.0  # swing of a force between hands that hold still above which a session may oscillate
SWING_MJ = 5.0  # energy created meanwhile above which it does: a long line that only rings makes none
ACTIVE_MJ = 5.0  # energy created beyond what ledgers account for, above which a session is active
ACTIVE_SHARE = 0.1  # share of what hands have put in that this energy must exceed as well
State = Literal["diverged", "oscillates", "not_passive", "passive"]  # state of a session; the last two are stable
Mark = Literal["unstable", "unstable_passive", "not_passive", "passive"]  # both verdicts of a session in one


def furthest_from_0(values: Sequence[float]) -> float:
    """Return the value furthest from 0: the worst of most measures."""
    return max(values, key=abs)


@dataclass(frozen=True, slots=True)
class ComparedMeasure:
    """Heading and unit of a measure, a sentence on what it is, its digits after the point, and the worst of its values."""

    heading: str
    unit: str
    what: str
    digits: int = 2
    worst: Callable[[Sequence[float]], float] = furthest_from_0


MEASURES: Mapping[str, ComparedMeasure] = {
    "created_mj": ComparedMeasure(
        "energy created", "mJ",
        "The most that the network had given out beyond what the hands had put in: the largest value over time of the "
        "object's kinetic energy and its own damper's take (in a scene: of all bodies' energy above that at first), less the "
        "work of all hands; 0 if there never was any.",
    ),
    "peak_force_n": ComparedMeasure("peak force", "N", "The largest force on any hand."),
    "force_step_n": ComparedMeasure("largest step", "N", "The largest change of force on any hand from one tick to the next."),
    "coherence_rms_mm": ComparedMeasure(
        "views apart, rms", "mm",
        "Distance between the object's positions as reported to two people at the same moment: root mean square over time, of "
        "the pair that is furthest apart.",
    ),
    "coherence_max_mm": ComparedMeasure("views apart, max", "mm", "The largest of these distances."),
    "hands_rms_mm": ComparedMeasure(
        "hands apart, rms", "mm",
        "Distance of two hands, each from where it began: root mean square over time, of the pair that is furthest apart.",
    ),
    "rest_mm": ComparedMeasure(
        "drift at rest", "mm",
        f"Distance of two hands, each from where it began, over the last {LAST_S:g} s, in which all hands hold where they "
        "began: what the network has left between them.", 3,
    ),
    "rest_swing_n": ComparedMeasure(
        "swing at rest", "N",
        f"Largest less smallest force on any hand over the same last {LAST_S:g} s.",
    ),
    "error_clean_n": ComparedMeasure(
        "force error to clean link", "N",
        "Root mean square over ticks and hands of the force's difference to the same method, hands and seed on a link "
        "without delay and loss.", 3,
    ),
    "error_ideal_n": ComparedMeasure(
        "force error to ideal", "N",
        "The same difference to the object directly in the hands: springs K and dampers B at the device rate, no network.", 3,
    ),
    "felt_error_percent": ComparedMeasure(
        "felt stiffness error", "%",
        "By how much the stiffness that a person feels under a static load is off the K asked for that person, K_felt / K - 1; "
        "of the person for whom this share is largest (felt.csv has everybody).", 1,
    ),
    "contact_n": ComparedMeasure("contact force", "N", "Scenes: the largest normal force at any tool."),
    "slip_mm": ComparedMeasure(
        "slip while lifted", "mm",
        "Scenes: the furthest that a tool slipped along the body that it touches while the object was lifted.", 3,
    ),
    "lifted_mm": ComparedMeasure("lifted", "mm", "Scenes: the greatest height of the object above its start.", 1, min),
    "lifted_s": ComparedMeasure(
        "time lifted", "s", "Scenes: the time for which the object was more than 10 mm above its start.", 2, min
    ),
}  # fmt: skip
COLUMNS = (
    "diverged", "diverged_s", "reason", "oscillates", "passive", "not_felt", "margin_mj", "leak_mj", *MEASURES,
    "felt_person", "lost", "late",
)  # fmt: skip
FELT_MEASURES = ("felt_npm", "error_percent", "added_mm_per_n")  # felt measures of each person, beside the K asked for


def created_j(work_j: Array, object_j: Array) -> float:
    """Return max over t of (object_j - work_j), at least 0 [J].

    Springs, lines and servers between hands and object begin empty. Passive ones keep object_j(t) <= work_j(t) at every t; any
    excess was created.
    """
    return max(0.0, float(np.max(object_j - work_j, initial=0.0)))


def created_at_rest_j(trace: SessionTrace) -> float:
    """Return the growth of `created_j` over the last LAST_S of a session [J]."""
    frames = max(1, round(LAST_S / trace.frame_s))
    return created_j(trace.work_j, trace.object_j) - created_j(trace.work_j[:-frames], trace.object_j[:-frames])


def furthest(position_m: Array) -> tuple[float, float]:
    """Return, of the pair furthest apart, the rms over time, and the largest distance of any pair [m]; shape (m, n, a)."""
    rms = most = 0.0
    for one, other in combinations(range(position_m.shape[1]), 2):
        square = ((position_m[:, one] - position_m[:, other]) ** 2).sum(axis=1)
        if square.size:
            rms = max(rms, float(np.sqrt(square.mean())))
            most = max(most, float(np.sqrt(square.max())))
    return rms, most


def swing_n(force_n: Array) -> float:
    """Return the largest less the smallest force of any hand on any axis [N]; shape (k, n, a)."""
    return float(np.ptp(force_n, axis=0).max()) if len(force_n) else 0.0


def force_error_n(force_n: Array, reference_n: Array) -> float | None:
    """Return the rms of |F - F_ref| over the ticks that both have, and over hands [N]; shapes (k, n, a)."""
    ticks = min(len(force_n), len(reference_n))
    if not ticks:
        return None
    return float(np.sqrt(((force_n[:ticks] - reference_n[:ticks]) ** 2).sum(axis=2).mean()))


def at_rest(trace: SessionTrace) -> tuple[float, float]:
    """Return the distance of hands [m] (of means) and the swing of forces [N] over the last LAST_S of a session."""
    frames = max(1, round(LAST_S / trace.frame_s))
    ticks = max(1, round(len(trace.force_n) * frames / max(1, len(trace.position_m))))
    middle = trace.position_m[-frames:].mean(axis=0, keepdims=True)
    return furthest(middle)[1], swing_n(trace.force_n[-ticks:])


def is_oscillating(swing_n: float, created_mj: float) -> bool:
    """Return whether forces swing between resting hands and energy is created meanwhile, both over LAST_S.

    A saturated device keeps an unstable session from growing. A passive line may ring for a while, but creates nothing.
    """
    return swing_n > SWING_N and created_mj > SWING_MJ


def put_in_j(work_j: Array) -> float:
    """Return what hands have put in, frame by frame, whatever came out in other frames [J]; work_j as in `SessionTrace`."""
    return float(np.maximum(0.0, np.diff(work_j, prepend=0.0)).sum())


def is_active(created_mj: float, put_in_mj: float) -> bool:
    """Return whether a session was active, the contrary of passive, by the energy that was created.

    created_mj: beyond what ledgers account for, and judge: the leak of the devices' sampled dampers, what lines lent, and what
    hands at rest were given.
    """
    return created_mj > max(ACTIVE_MJ, ACTIVE_SHARE * put_in_mj)


def state_of(measures: Mapping[str, Any]) -> State:
    """Return a session's state; a passivity that is not known counts as passive, as in every count of `not_passive`."""
    if measures["diverged"]:
        return "diverged"
    if measures["oscillates"]:
        return "oscillates"
    return "not_passive" if measures["passive"] is False else "passive"


def mark_of(measures: Mapping[str, Any]) -> Mark:
    """Return a session's two verdicts: `unstable` alone is not passive either."""
    state = state_of(measures)
    if state in ("not_passive", "passive"):
        return state
    return "unstable" if measures["passive"] is False else "unstable_passive"


def read(trace: SessionTrace, summary: Summary, diverged: str, clean: Array, ideal: Array | None) -> dict[str, Any]:
    """Return all columns but those of the felt stiffness; of a session that diverged, up to then.

    Measures of two people are None for one alone. clean, ideal: forces to compare with, (k, n, a); ideal is None if unstable.
    """
    rms, most = furthest(trace.view_m)
    users = people(summary)
    worst = worst_margin(users)
    apart_m, swing = at_rest(trace)
    seen = any(user.get("oscillates") is True for user in users)  # at a device port, whenever that was
    oscillates = not diverged and (seen or is_oscillating(swing, created_at_rest_j(trace) * 1e3))
    judged = felt(summary)
    softer = judged.sentence.startswith(SOFTER)  # the felt stiffness has a column of its own
    created_mj = created_j(trace.work_j, trace.object_j) * 1e3
    leak_mj = -1e3 * add_floats(min(0.0, user["energy"]["device_leak_j"]) for user in users)
    lent_mj = -1e3 * add_floats(min(0.0, user["energy"].get("line_margin_j") or 0.0) for user in users)
    active = is_active(created_mj - leak_mj - lent_mj - 1e3 * trace.refilled_j, put_in_j(trace.work_j) * 1e3)
    pair = trace.position_m.shape[1] > 1
    scene = dig(summary, "server", "scene") or {}
    return {
        "diverged": bool(diverged),
        "diverged_s": summary["seconds"] if diverged else None,
        "reason": diverged,
        "oscillates": oscillates,
        "passive": False if active else summary["passive"],
        "not_felt": judged.sentence if judged.tone == "warn" and not softer and not diverged and not oscillates else "",
        "margin_mj": worst[0] * 1e3 if worst else None,
        "leak_mj": leak_mj,
        "created_mj": created_mj,
        "peak_force_n": largest(user["peak_force_n"] for user in users),
        "force_step_n": largest(user["peak_force_step_n"] for user in users),
        "coherence_rms_mm": rms * 1e3 if pair and trace.sees_object else None,
        "coherence_max_mm": most * 1e3 if pair and trace.sees_object else None,
        "hands_rms_mm": furthest(trace.position_m)[0] * 1e3 if pair else None,
        "rest_mm": apart_m * 1e3 if pair and not diverged else None,
        "rest_swing_n": None if diverged else swing,
        "error_clean_n": force_error_n(trace.force_n, clean),
        "error_ideal_n": None if ideal is None else force_error_n(trace.force_n, ideal),
        "contact_n": scene.get("peak_contact_n"),
        "slip_mm": _thousand(scene.get("lifted_slip_m")),
        "lifted_mm": _thousand(scene.get("lifted_m")),
        "lifted_s": scene.get("lifted_s"),
        "lost": add_integers(user["link"]["lost"] for user in users),
        "late": add_integers(user["link"]["late"] for user in users),
    }


def _thousand(value: Any) -> float | None:
    return 1e3 * value if is_number(value) else None


def largest(values: Any) -> float | None:
    """Return the largest of those values that are numbers, or None."""
    return max((float(value) for value in values if is_number(value)), default=None)
