"""Phases of a trial, one after the other: at the beginning of each its cue is shown, and a marker is set.

They are timed from the beginning of the session, when everybody is there and ready. The last one lasts until the trial ends.
"""

from collections.abc import Sequence
from math import inf, isclose
from typing import Annotated, NamedTuple

import msgspec

from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.types import Name
from cogrip.protocol.texts import MARK_BYTES

MOST_PHASES = 100
_ROUNDING_S = 1e-6


class Phase(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[[blocks.phases]]. seconds: None of the last one, until the trial ends; cue: what participants are shown meanwhile."""

    name: Name
    seconds: Annotated[float, msgspec.Meta(ge=0.1, le=1e6)] | None = None
    cue: Annotated[str, msgspec.Meta(max_length=200)] = ""


class Spell(NamedTuple):
    """A phase in a recorded session: from when to when [s], the end not in it."""

    name: str
    begin_s: float
    end_s: float


class PhaseWatch:
    """Tells which phases have begun. next_s: when the next one begins [s], inf where none is left."""

    def __init__(self, phases: Sequence[Phase]) -> None:
        self._left: list[tuple[float, Phase]] = []
        begin_s = 0.0
        for phase in phases:
            self._left.append((begin_s, phase))
            begin_s += phase.seconds or inf

    @property
    def next_s(self) -> float:
        return self._left[0][0] if self._left else inf

    def look(self, time_s: float) -> list[Phase]:
        """Return the phases that have begun since the last look, oldest first. time_s: since the session's beginning."""
        begun = []
        while self._left and self.next_s <= time_s + _ROUNDING_S:
            begun.append(self._left.pop(0)[1])
        return begun


def phase_begun(run: str, phase: str) -> str:
    """Return the marker of a phase's beginning, by the name of its run folder."""
    return f"phase {run} {phase}"


def spells(run: str, markers: Sequence[tuple[float, str]], end_s: float) -> list[Spell]:
    """Return the phases that began in a run, by its markers, (time [s], text). end_s: when the trial ended."""
    before = phase_begun(run, "")
    begun = [(time_s, text.removeprefix(before)) for time_s, text in markers if text.startswith(before)]
    ends = [*[time_s for time_s, _ in begun[1:]], end_s]
    return [Spell(name, time_s, until_s) for (time_s, name), until_s in zip(begun, ends, strict=False)]


def unfit_phases(phases: Sequence[Phase], seconds: float, longest_run: str) -> str:
    """Return why a trial of so many seconds cannot have these phases, "" if it can.

    longest_run: of all names of its run folders.
    """
    if len(phases) > MOST_PHASES:
        return f"{len(phases)} are too many; a trial has at most {MOST_PHASES}"
    names = [phase.name for phase in phases]
    if twice := next((name for name in names if names.count(name) > 1), None):
        return f"{twice} is named twice; give each one name"
    for name in names:
        if (size := len(phase_begun(longest_run, name).encode())) > MARK_BYTES:
            return (
                f"{name}: its marker is {size - MARK_BYTES} bytes too long; take a shorter name, here or for the block"
            )
    if endless := next((phase.name for phase in phases[:-1] if phase.seconds is None), None):
        return f"{endless}: seconds is missing; only the last phase goes without, and lasts until the trial ends"
    told = add_floats(phase.seconds or 0.0 for phase in phases)
    if phases and phases[-1].seconds is None:
        if told + _ROUNDING_S >= seconds:
            return (
                f"{told:g} s are over before {names[-1]} begins, as a trial lasts session.seconds = {seconds:g}; make them "
                "shorter, or the trial longer"
            )
    elif phases and not isclose(told, seconds, abs_tol=_ROUNDING_S):
        return (
            f"they last {told:g} s, and a trial session.seconds = {seconds:g}; make them alike, or leave out the seconds of "
            f"{names[-1]}, which then lasts until the trial ends"
        )
    return ""
