"""Changes of one setting that would help, by the model, the best first; `sim/session/laboratory_check.py` tries them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from math import inf, log
from typing import Any

import msgspec

from cogrip.client.rendered_damper import rounded_down
from cogrip.devices.device import DeviceError
from cogrip.protocol.settings import Settings, resolve
from cogrip.protocol.settings_table import SettingsError
from cogrip.sim.analysis.advice import AMPLE, Advice, advise, ample, at_best
from cogrip.sim.analysis.lifted_model import LiftedModel
from cogrip.sim.analysis.linear_session import ModelError
from cogrip.sim.analysis.stability import Limit


@dataclass(frozen=True, slots=True)
class Score:
    """The score of a session, compared in this order: fewer warnings, stable further, felt stiffness nearer to what is asked.

    warnings: those of the feel apart, which `missed` counts; reach: log of limit over stiffness, up to AMPLE; missed: the
    largest |felt / asked - 1|, of what was asked before any change.
    """

    warnings: int
    reach: float
    missed: float

    def key(self) -> tuple[float, ...]:
        return self.warnings, -round(self.reach, 6), round(self.missed, 2)


@dataclass(frozen=True, slots=True)
class Change:
    """One setting that would help, and the scores before and after it; `measured`: the felt stiffness is of sessions."""

    key: str
    value: Any
    before: Score
    after: Score
    measured: bool = True  # where sessions looked at all: the felt stiffness is theirs

    @property
    def setting(self) -> str:
        """The override as `--set` takes it."""
        return self.written(self.key, self.value)

    @staticmethod
    def written(key: str, value: Any) -> str:
        """Return one override as `--set` takes it."""
        return f"{key}={msgspec.json.encode(value).decode()}"

    @property
    def effect(self) -> str:
        """Effect of the change, in words."""
        before, after = self.before, self.after
        parts = []
        if after.warnings < before.warnings:
            parts.append(f"{before.warnings - after.warnings} of {before.warnings} warnings would go")
        if round(after.missed, 2) < round(before.missed, 2):
            parts.append(
                f"felt stiffness would miss what is asked by {100.0 * after.missed:.0f} % in place of "
                f"{100.0 * before.missed:.0f} %"
            )
        text = "; ".join(parts) or "it would stay stable further up"
        return (
            text if self.key != "playout.frames" or self.value == "auto" else f"{text}, as long as no loop wakes late"
        )


def change_to(settings: Settings, now: Advice, key: str, value: Any) -> Change:
    """Return a change with its score by the model. Raises SettingsError or ModelError."""
    asked = [user.asked_npm for user in now.users]
    return Change(
        key,
        value,
        score_of(now, asked),
        score_of(advise(resolve(msgspec.to_builtins(settings), {key: value}), ample), asked),
    )


def ranked_changes(
    settings: Settings, now: Advice, progress: Callable[[int, int], None] = lambda tried, total: None
) -> Iterator[Change]:
    """Yield the changes that help, the best first; of equals the one that costs least.

    The exact limit of stability takes long to find where delays are long. So every candidate gets an optimistic score first,
    from a few stiffnesses; then they are scored exactly, the most promising first, until no other can be better.
    progress: how many candidates were scored, of how many.
    """
    asked = [user.asked_npm for user in now.users]
    before = score_of(now, asked)
    candidates = list(candidates_of(settings, now))
    table = msgspec.to_builtins(settings)

    def score(number: int, search: Callable[[LiftedModel], Limit]) -> Score:
        key, value = candidates[number]
        return score_of(advise(resolve(table, {key: value}), search), asked)

    queue: list[tuple[tuple[float, ...], int, Score | None]] = []  # with a score where it was looked at closely
    for number in range(len(candidates)):
        progress(number, len(candidates))
        with suppress(SettingsError, ModelError, DeviceError):  # it cannot be set, or has no model: no candidate
            queue.append((score(number, at_best).key(), number, None))
    heapify(queue)
    while queue and queue[0][0] < before.key():
        _, number, after = heappop(queue)
        if after is None:
            after = score(number, ample)
            heappush(queue, (after.key(), number, after))
        else:
            yield Change(*candidates[number], before, after)


def score_of(advice: Advice, asked_npm: Sequence[float]) -> Score:
    limit, most = advice.limit.stiffness_npm, advice.stiffness_npm
    reach = inf if limit is None else log(limit / most) if limit else -inf
    pairs = zip(advice.users, asked_npm, strict=True)
    missed = max((abs(user.felt_npm / asked - 1.0) for user, asked in pairs if asked), default=0.0)
    warnings = sum(finding.warns and finding.topic != "feel" for finding in advice.findings)
    return Score(warnings, min(reach, log(AMPLE)), missed)


def candidates_of(settings: Settings, now: Advice) -> Iterator[tuple[str, Any]]:
    """Yield changes worth trying, those that cost least first."""
    coupling = settings.coupling
    if not coupling.traits.passive:
        yield "coupling.kind", "wave"
    if coupling.server_step == "paper":
        yield "coupling.server_step", "passive"
    if coupling.decimator != "boxcar":
        yield "coupling.decimator", "boxcar"
    if not coupling.compensate:
        yield "coupling.compensate", True
    yield "coupling.impedance_nspm", rounded_down(min(user.largest_impedance_nspm for user in now.users))
    b = coupling.impedance_nspm
    for share in (1.25, 1.5, 2.0, 3.0, 0.75, 0.5, 0.25, 0.1) if b != "auto" else ():
        yield "coupling.impedance_nspm", float(f"{share * float(b):.3g}")
    for share in (0.75, 0.5, 0.25, 0.1):
        yield "coupling.stiffness_npm", float(f"{share * coupling.stiffness_npm:.3g}")
    frames = settings.playout.frames
    if frames and frames != "auto":
        # the slack against jitter, which the model does not know: for what nothing else does
        yield "playout.frames", frames - 1
