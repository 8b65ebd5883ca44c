"""Changes of one setting that would help, by the model, the best first; `laboratory_check` tries them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from heapq import heapify, heappop, heappush
from math import inf, log
from typing import Any

import msgspec

from cogrip.analysis.advice.advice import AMPLE, Advice, advise, ample, at_best
from cogrip.analysis.advice.finding import LEVELS, Level, plain, said_of, warning_rows
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import ModelError
from cogrip.analysis.linear.stability import Limit
from cogrip.client.safety.rendered_damper import rounded_down
from cogrip.devices.device import DeviceError
from cogrip.machine.addition import add_integers
from cogrip.protocol.settings.coupling_kinds import COUPLING_KINDS
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError

TOLD = 1.03  # factor of what a change costs above which it is told
COSTS: dict[tuple[str, Any], str] = {
    ("coupling.kind", "local"): "a wall that moves is felt by its place alone, and comes to a hand step by step",
    ("coupling.compensate", True): "the spring is rendered stiffer, by the delay as it is measured",
}


@dataclass(frozen=True, slots=True)
class Score:
    """The score of a session, compared in this order: fewer warnings, stable further, felt stiffness nearer to what is asked.

    warnings: those of the feel apart, which `missed` counts; reach: log of limit over stiffness, up to AMPLE; missed: the
    largest |felt / asked - 1|, of what was asked before any change.
    rows: warnings as they are printed, of the feel and of sessions too, people with the same one in a row
    felt_npm, free_kg: of each person, what contact and free motion feel like
    levels: the worst level of what is said, by topic and person; lost: refused, or not stable
    """

    warnings: int
    reach: float
    missed: float
    rows: int = 0
    felt_npm: tuple[float, ...] = ()
    free_kg: tuple[float, ...] = ()
    levels: Mapping[tuple[str, str], Level] = field(default_factory=dict)
    lost: bool = False

    def key(self) -> tuple[float, ...]:
        return self.warnings, -round(self.reach, 6), round(self.missed, 2)

    def spoils(self, before: Score) -> bool:
        """Return whether something that is judged gets a worse level than before.

        Nothing is worse than a session that is refused or not stable; and a warning that goes may cost feel.
        """
        if before.lost:
            return False
        dear = {topic for topic, _ in self.levels} - ({"feel"} if self.warnings < before.warnings else set())
        return any(
            LEVELS.index(level) > LEVELS.index(before.levels.get(about, "ok"))
            for about, level in self.levels.items()
            if about[0] in dear
        )


@dataclass(frozen=True, slots=True)
class Change:
    """One setting that would help, and the scores before and after it; `measured`: the felt stiffness is of sessions.

    also: what has to be set with it
    """

    key: str
    value: Any
    before: Score
    after: Score
    measured: bool = True  # True where sessions were run at all: the felt stiffness is theirs
    also: tuple[tuple[str, Any], ...] = ()

    @property
    def overrides(self) -> dict[str, Any]:
        """The settings that are changed."""
        return {self.key: self.value, **dict(self.also)}

    @property
    def setting(self) -> str:
        """The overrides as `--set` takes them."""
        return " --set ".join(self.written(key, value) for key, value in self.overrides.items())

    @staticmethod
    def written(key: str, value: Any) -> str:
        """Return one override as `--set` takes it."""
        return f"{key}={msgspec.json.encode(value).decode()}"

    @property
    def effect(self) -> str:
        """Effect of the change, and what it costs, in words."""
        before, after = self.before, self.after
        parts = []
        if after.rows < before.rows:
            parts.append(f"{before.rows - after.rows} of {before.rows} warnings would go")
        if round(after.missed, 2) < round(before.missed, 2):
            parts.append(
                f"felt stiffness would miss what is asked by {100.0 * after.missed:.0f} % in place of "
                f"{100.0 * before.missed:.0f} %{_in_place(before.felt_npm, after.felt_npm, 'N/m')}"
            )
        if parts and _most_grown(after.free_kg, before.free_kg) > TOLD:
            parts.append(f"free motion would be lighter{_in_place(after.free_kg, before.free_kg, 'kg', swapped=True)}")
        text = "; ".join(parts) or "it would stay stable further up"
        costs = "; ".join(self.costs)
        return f"{text}; it costs: {costs}" if costs else text

    @property
    def costs(self) -> tuple[str, ...]:
        """Words for all that the change makes worse."""
        before, after = self.before, self.after
        found = [COSTS[self.key, self.value]] if (self.key, self.value) in COSTS else []
        if self.key == "playout.frames" and self.value != "auto":
            found.append("it holds as long as no loop wakes late")
        if _most_grown(before.free_kg, after.free_kg) > TOLD:
            found.append(f"free motion is heavier{_in_place(before.free_kg, after.free_kg, 'kg')}")
        if _most_grown(after.felt_npm, before.felt_npm) > TOLD:
            found.append(f"contact is softer{_in_place(after.felt_npm, before.felt_npm, 'N/m', swapped=True)}")
        return tuple(found)


def _most_grown(before: Sequence[float], after: Sequence[float]) -> float:
    """Return the largest factor by which somebody's number has grown."""
    return max((new / old for old, new in zip(before, after, strict=True) if old > 0.0), default=1.0)


def _in_place(before: Sequence[float], after: Sequence[float], unit: str, *, swapped: bool = False) -> str:
    """Return both numbers of the person whose number grows most; "" where they are not known."""
    if not before or len(before) != len(after):
        return ""
    old, new = max(zip(before, after, strict=True), key=lambda pair: pair[1] / pair[0] if pair[0] > 0.0 else 0.0)
    if swapped:
        old, new = new, old
    return f" ({plain(new, 3)} {unit} in place of {plain(old, 3)})"


def change_to(settings: Settings, now: Advice, key: str, value: Any) -> Change:
    """Return a change with its score by the model. Raises SettingsError or ModelError."""
    asked = [user.asked_npm for user in now.users]
    also = besides(settings, now, key, value)
    after = advise(resolve(msgspec.to_builtins(settings), {key: value, **dict(also)}), ample)
    return Change(key, value, score_of(now, asked), score_of(after, asked), also=also)


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
        return score_of(advise(resolve(table, {key: value, **dict(besides(settings, now, key, value))}), search), asked)

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
        elif not after.spoils(before):
            key, value = candidates[number]
            yield Change(key, value, before, after, also=besides(settings, now, key, value))


def score_of(advice: Advice, asked_npm: Sequence[float]) -> Score:
    limit, most = advice.limit.stiffness_npm, advice.stiffness_npm
    reach = inf if limit is None else log(limit / most) if limit else -inf
    pairs = zip(advice.users, asked_npm, strict=True)
    missed = max((abs(user.felt_npm / asked - 1.0) for user, asked in pairs if asked), default=0.0)
    warnings = add_integers(finding.warns and finding.topic != "feel" for finding in advice.findings)
    names = [user.name for user in advice.users]
    levels: dict[tuple[str, str], Level] = {}
    for finding in advice.findings:
        about = finding.topic, said_of(finding, names)
        levels[about] = max(levels.get(about, "ok"), finding.level, key=LEVELS.index)
    return Score(
        warnings, min(reach, log(AMPLE)), missed,
        rows=warning_rows(advice.findings, names),
        felt_npm=tuple(user.felt_npm for user in advice.users),
        free_kg=tuple(user.free_mass_kg for user in advice.users),
        levels=levels,
        lost=bool(advice.refusals) or not advice.verdict.stable,
    )  # fmt: skip


def besides(settings: Settings, now: Advice, key: str, value: Any) -> tuple[tuple[str, Any], ...]:
    """Return what has to be set with a change: damper and spring of a contact, where devices do not carry them."""
    if key != "coupling.kind" or not COUPLING_KINDS[value].local:
        return ()
    bounds = {
        "damping_nspm": min(user.largest_impedance_nspm for user in now.users),
        "stiffness_npm": min(user.advised_stiffness_npm for user in now.users),
    }
    return tuple(
        (f"coupling.{name}", rounded_down(most))
        for name, most in bounds.items()
        if getattr(settings.coupling, name) > most
    )


def candidates_of(settings: Settings, now: Advice) -> Iterator[tuple[str, Any]]:
    """Yield changes worth trying, those that cost least first."""
    coupling = settings.coupling
    if not coupling.traits.passive or coupling.traits.local:
        yield "coupling.kind", "wave"
    if coupling.server_step == "paper":
        yield "coupling.server_step", "passive"
    if coupling.decimator != "boxcar":
        yield "coupling.decimator", "boxcar"
    if not coupling.compensate:
        yield "coupling.compensate", True
    if settings.object.traits.fixed and not coupling.traits.local:
        yield "coupling.kind", "local"  # what gives way to many people is, in the end, as soft as their lines
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
