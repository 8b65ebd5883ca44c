"""Judge the gates of a room (`coupling.kind = "partner"`, theory 5b) by the recordings: what all hands together took.

Symbols: x place of a device, F force that it held until its next sample, both as recorded; E_0 budget of a person.

    W_i(t) = sum F . (x_{k+1} - x_k)             margin = min over t of sum_i (W_i(t) + E_0,i + refill_i(t))

refill_i is the most that a gate may have refilled: its power times the time at rest, which the recorded velocities tell. A hand
counts E_0 once for each time that it took its seat. Nothing that a client says of its own ledger enters.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cogrip.client.coupling.partner.spring_gate import BUDGET_J, REFILL_W, REST_MPS, REST_S
from cogrip.machine.addition import add_floats, add_integers
from cogrip.protocol.recording.reader import RecordingError
from cogrip.results.reading.records import End, RunRecords, open_run
from cogrip.results.reading.summary_values import Summary, people, told_gates
from cogrip.results.verdict.verdict import passive_of

Array = NDArray[np.float64]
_COLUMNS = ("tick", "position_m", "velocity_mps", "force_n", "age_ticks")
_ALONE = {"position_scale": 1.0, "force_scale": 1.0, "workspace_limit_m": "none", "gravity_compensation": False}
"""Settings of a hand with which the force on it is the coupling's alone."""


class HandWork(NamedTuple):
    """One hand over a session, at the times [s] of its ticks: W [J] before each, and the most that its gate was refilled by."""

    time_s: Array
    work_j: Array
    refill_j: Array
    sessions: int

    @property
    def taken_j(self) -> float:
        """Return the most that the hand took beyond what it had put in."""
        return max(0.0, -float(self.work_j.min(initial=0.0)))

    @property
    def budget_j(self) -> float:
        """Return what it may take by itself, in all: E_0 of each session, and the refill."""
        return self.sessions * BUDGET_J + float(self.refill_j[-1] if len(self.refill_j) else 0.0)


def hand_work(end: End) -> HandWork:
    """Return the work of one person's hand from its client's recording. Raises RecordingError, KeyError."""
    columns = end.columns("tick", *_COLUMNS)
    time_s = columns["time_s"].astype(float)
    place, force = (np.atleast_2d(columns[name].astype(float).T).T for name in ("position_m", "force_n"))
    speed = np.linalg.norm(np.atleast_2d(columns["velocity_mps"].astype(float).T).T, axis=1)
    known = np.isfinite(place).all(axis=1)
    time_s, place, force, speed = time_s[known], place[known], force[known], speed[known]
    if not len(time_s):
        return HandWork(time_s, time_s, time_s, 1)
    axes, ticks = min(place.shape[1], force.shape[1]), columns["tick"].astype(float)[known]
    seen = np.arange(len(ticks)) - columns["age_ticks"].astype(int)[known]  # a sample tells of a motion that is over
    acting = force[np.maximum(seen[:-1], 0), :axes] * (seen[:-1] >= 0)[:, None]
    took = (acting * np.diff(place[:, :axes], axis=0)).sum(axis=1)
    begun = np.flatnonzero(np.diff(ticks) < 0.0)  # the same person came again
    took[begun] = 0.0
    work = np.concatenate(([0.0], np.cumsum(took)))
    return HandWork(time_s, work, _refill(time_s, speed), 1 + len(begun))


def _refill(time_s: Array, speed_mps: Array) -> Array:
    """Return REFILL_W times the time so far for which the hand had been slower than REST_MPS for REST_S."""
    moved = np.where(speed_mps < REST_MPS, -np.inf, time_s)
    rested_s = time_s - np.maximum(np.maximum.accumulate(moved), time_s[0])
    steps = np.diff(time_s, prepend=time_s[0])
    result: Array = REFILL_W * np.cumsum(np.where(rested_s >= REST_S, steps, 0.0))
    return result


def least_margin_j(hands: Mapping[str, HandWork]) -> float:
    """Return the least, over the session, of what all hands together may still take [J]."""
    times = np.concatenate([hand.time_s for hand in hands.values()])
    order = np.argsort(times, kind="stable")
    steps = np.concatenate([
        np.diff(hand.work_j + hand.refill_j, prepend=0.0) for hand in hands.values()
    ])  # fmt: skip
    whole = np.cumsum(steps[order])
    budgets = add_integers(hand.sessions for hand in hands.values()) * BUDGET_J
    return budgets + float(whole.min(initial=0.0))


def judge_gates(folder: Path, summary: Summary) -> bool:
    """Put into the summary of a run what the recordings in its folder tell of the gates. Return whether they tell anything.

    They tell nothing of another scheme, where the recording of anybody who had a seat is not there or damaged, and where a hand
    felt more than the coupling: effects, a workspace limit, its handle's weight.
    """
    if not isinstance(summary.get("gates"), dict):
        return False
    try:
        records = open_run(folder)
        hands = _hands(records, summary)
    except (FileNotFoundError, RecordingError, KeyError, ValueError):
        return False
    if not hands:
        return False
    taken_j = {name: hand.taken_j for name, hand in hands.items()}
    summary["gates"] = told_gates(
        len(hands), add_floats(hand.budget_j for hand in hands.values()), least_margin_j(hands), taken_j
    )
    summary["passive"] = passive_of(people(summary), float(summary["credit_j"]), summary["gates"])
    return True


def _hands(records: RunRecords, summary: Summary) -> dict[str, HandWork]:
    """Return the hands of all who had a seat; none where one of them is not recorded whole."""
    held = [str(user["name"]) for user in people(summary) if user.get("state") is not None or _received(user)]
    mixed = any(user.get("effects") is not None or not _alone(user.get("hand")) for user in people(summary))
    if mixed or any(name not in records.clients for name in held):
        return {}
    found = {name: hand_work(records.clients[name]) for name in held}
    return {} if any(records.clients[name].damage for name in held) else found


def _alone(hand: Any) -> bool:
    """Return whether the force on a hand with these settings, as a summary has them, is the coupling's alone."""
    return not isinstance(hand, dict) or all(hand.get(key, plain) == plain for key, plain in _ALONE.items())


def _received(user: dict[str, Any]) -> bool:
    link = user.get("link")
    return bool(isinstance(link, dict) and isinstance(link.get("up"), dict) and link["up"].get("received"))
