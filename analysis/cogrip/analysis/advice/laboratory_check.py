"""Sessions in virtual time that check advice before it is given: they include what the linear model leaves out.

session   the settings as they stand, with their own hands and devices: passive and stable?
felt      a static load on the same link (`felt_probe`), once a seed: stiffness at rest, jitter and loss included
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, islice
from math import ceil, isfinite
from statistics import mean
from typing import Literal

from msgspec import to_builtins
from msgspec.structs import replace

from cogrip.analysis.advice.advice import Advice, feel_level
from cogrip.analysis.advice.advice_change import Change, Score, change_to, ranked_changes
from cogrip.analysis.advice.finding import Finding, Level, plain, warning_rows
from cogrip.analysis.advice.line_advice import hand_query
from cogrip.analysis.advice.stiffest import Stiffest, eased, stiffest
from cogrip.analysis.feel.felt_probe import measure_felt
from cogrip.devices.for_user import make_for
from cogrip.devices.registry import is_real
from cogrip.machine.addition import add_floats, add_integers
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.room import not_passive, resolve, seat_axes
from cogrip.protocol.settings.sections import Settings, User
from cogrip.results.reading.summary_values import Summary, task_goals, task_of, task_result
from cogrip.results.verdict.felt_as_intended import SOFTER
from cogrip.results.verdict.judgement import Tone
from cogrip.results.verdict.verdict import felt as felt_as_intended
from cogrip.results.verdict.verdict import passive, stable
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

Values = tuple[float | None, ...]
"""Felt stiffness of each seed [N/m]; None where nothing came to rest."""
LINES = 6  # people times seeds on a network that is random; others are the same with every seed
MOST_SEEDS = 3
SESSION_S, LONGEST_S = 6.0, 20.0  # length of a session, and of the longest where hands or outages begin late
SHORT_S = 3.0  # length below which a session says little
EASED = ((1.0, 1.0), (1.0, 0.7), (0.75, 1.0), (0.75, 0.6), (0.5, 0.6))  # factors on b and K, the stiffest first
MOST_CHANGES = 4  # most changes that are tried in the laboratory
MORE_CONTROLLED = 0.01  # most by which the share of ticks that the device port changes may grow
DIRECTIONS: tuple[Literal["up", "down"], ...] = ("up", "down")
_LEVELS: dict[Tone, Level] = {"good": "ok", "warn": "note", "bad": "warning"}
_TONES: tuple[Tone, ...] = tuple(_LEVELS)


@dataclass(frozen=True, slots=True)
class Check:
    """The results of the sessions of some settings.

    passive, stable: verdicts on the session; said: the sentences of these, and on the feel, that are not good
    felt_npm: of each person with a spring, in the order of the settings: a value a seed, None where nothing came to rest;
    empty where no balanced load exists (one person alone at a free object)
    begun_s: when the last of hands and the first of periodic outages have begun, of those that the settings' time reaches
    stand_ins: people whose hardware a simulated device replaced
    controlled: largest share of ticks in which a device port changed what somebody felt; let_go: how often a force was
    task: what became of the task of a scene, None without one; done: whether it was done
    """

    passive: Tone
    stable: Tone
    said: tuple[str, ...]
    felt_npm: dict[str, Values]
    asked_npm: dict[str, float]
    seconds: float
    begun_s: float
    stand_ins: tuple[str, ...]
    controlled: float = 0.0
    let_go: int = 0
    task: str | None = None
    done: bool = True

    def missed(self, asked_npm: dict[str, float]) -> float | None:
        """Return the largest |mean felt / asked - 1| of anybody; None if nobody's was measured, 1 where nothing rests."""
        shares = [
            1.0
            if None in values
            else abs(add_floats(value or 0.0 for value in values) / len(values) / asked_npm[name] - 1.0)
            for name, values in self.felt_npm.items()
            if asked_npm.get(name)
        ]
        return max(shares, default=None)

    def spoils(self, before: Check) -> bool:
        """Return whether sessions judge something worse than before: a verdict, the device port, a task."""
        return (
            _TONES.index(self.passive) > _TONES.index(before.passive)
            or _TONES.index(self.stable) > _TONES.index(before.stable)
            or self.controlled > before.controlled + MORE_CONTROLLED
            or self.let_go > before.let_go
            or (before.done and not self.done)
        )

    def scored(self, score: Score, missed: float) -> Score:
        """Return a score of the model with what sessions have measured in its place, and their warnings counted, too."""
        felt = tuple(
            0.0 if None in values else mean(value or 0.0 for value in values) for values in self.felt_npm.values()
        )
        shown = (self.session, *self.felt())
        whole = len(felt) == len(score.felt_npm)
        return dataclasses.replace(
            score, missed=missed, rows=score.rows + warning_rows(shown, ()), felt_npm=felt if whole else score.felt_npm
        )

    @property
    def session(self) -> Finding:
        """The finding on the session."""
        worst = max(self.passive, self.stable, key=_TONES.index)
        people = (
            f" ({', '.join(self.stand_ins)}: a simulated device stood in for the hardware)" if self.stand_ins else ""
        )
        text = f"a session of {self.seconds:g} s with these settings{people}: "
        text += "passive and stable. " if worst == "good" else ""
        text = f"{text}{' '.join(self.said)}".rstrip(". ")
        text += f"; {self.beyond}" if self.beyond else ""
        text += f"; {self.task}" if self.task else ""
        if not self.done:
            return Finding("laboratory", text, "warning")
        doubt = worst == "good" and (self.beyond or self.said)
        return Finding("laboratory", text, "note" if doubt else _LEVELS[worst])

    @property
    def beyond(self) -> str:
        """Return the part of the settings that the session did not reach, "" if it reached all."""
        if self.begun_s > self.seconds:
            return f"what begins at {self.begun_s:g} s, hands or outages, is beyond it"
        return f"less than {SHORT_S:g} s tell little" if self.seconds < SHORT_S else ""

    def felt(self, expected_npm: Mapping[str, float] | None = None) -> tuple[Finding, ...]:
        """Return findings on the felt stiffness; people of the same numbers share one.

        expected_npm: by name, the stiffness to compare with; else the one that the settings ask for.
        """
        if not self.felt_npm:
            text = "the felt stiffness was not measured: these people cannot hold the object still against each other"
            return (Finding("laboratory", text, "note"),)
        expected = expected_npm or self.asked_npm
        alike: dict[tuple[float, float, Values], list[str]] = {}
        for name, values in self.felt_npm.items():
            alike.setdefault((self.asked_npm[name], expected[name], values), []).append(name)
        return tuple(
            Finding(
                "laboratory", f"{', '.join(names)}: a spring of {plain(asked)} N/m {words(values)}", _level(values, one)
            )
            for (asked, one, values), names in alike.items()
        )


def words(values: Values) -> str:
    """Return the felt stiffness over the seeds in words."""
    where = f"in {len(values)} sessions over this link" if len(values) > 1 else "over this link"
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return f"never came to rest under a constant load {where}"
    low, high = (plain(value, 3) for value in (min(known), max(known)))
    return f"felt like {low if low == high else f'{low} to {high}'} N/m at rest {where}"


def _level(values: Values, expected_npm: float) -> Level:
    known = [value for value in values if value is not None]
    return feel_level(add_floats(known) / len(known), expected_npm) if len(known) == len(values) else "warning"


def check(settings: Settings) -> Check:
    """Run the sessions. Raises DeviceError for a device that cannot be had."""
    stand_ins = tuple(user.name for user in settings.users if is_real(user.device))
    settings = replace(settings, users=tuple(_stand_in(settings, user) for user in settings.users))
    whole = kind_of(settings.object.kind).plain  # else the session is all that there is, and its task wants its time
    least_s = max(SESSION_S, min(LONGEST_S, _begun_s(settings) + SESSION_S)) if whole else LONGEST_S
    given_s, seconds = settings.seconds, min(settings.seconds, least_s)
    laboratory = Laboratory(replace(settings, seconds=seconds))
    laboratory.run()
    summary = of_laboratory(laboratory)
    judged = passive(summary), stable(summary), felt_as_intended(summary)
    # the static load measures how soft it is
    said = tuple(each.sentence for each in judged if each.tone != "good" and not each.sentence.startswith(SOFTER))
    told, done = _task(summary, seconds >= given_s)
    felt: dict[str, list[float | None]] = {}
    asked: dict[str, float] = {}
    seeds = min(MOST_SEEDS, ceil(LINES / len(settings.users))) if _draws(settings) else 1
    for seed in range(seeds):
        for person in measure_felt(replace(settings, seed=settings.seed + seed)):
            felt.setdefault(person.person, []).append(person.felt_npm)
            asked[person.person] = person.asked_npm
    return Check(
        judged[0].tone, judged[1].tone, said,
        {name: tuple(values) for name, values in felt.items()}, asked, seconds,
        _begun_s(settings), stand_ins,
        max((user["controlled"] or 0.0 for user in summary["users"]), default=0.0),
        add_integers(user["let_go"] or 0 for user in summary["users"]),
        told, done,
    )  # fmt: skip


def _task(summary: Summary, over: bool) -> tuple[str | None, bool]:
    """Return what became of a task, None where that is not known, and whether it was done. over: the session is."""
    task = task_of(summary)
    if task is None or not (over or task.get("reached") is True):
        return None, True
    goals = "; ".join(f"{words} {value}" for words, value in task_goals(task))
    return f"task {task_result(task)}: {task.get('body')} {goals}", task.get("reached") is True


def _draws(settings: Settings) -> bool:
    """Return whether the link draws its delays or losses by chance."""
    link = settings.link
    directions = [link.direction(direction) for direction in DIRECTIONS]
    return any(
        direction.jitter_ms or direction.loss or direction.duplicate or direction.reorder for direction in directions
    ) or any(map(link.trace_of, DIRECTIONS))


def _begun_s(settings: Settings) -> float:
    """Return when everything has begun that begins late: hands that wait, and outages."""
    begun: list[tuple[float, float]] = []  # start and end of each beginning
    for user in settings.users:
        query = hand_query(user)
        begun += [(float(query[key]),) * 2 for key in ("delay_s", "start_s") if _is_number(query.get(key, ""))]
    for direction in DIRECTIONS:
        profile = settings.link.direction(direction)
        begun.append((profile.outage_every_s, profile.outage_every_s + profile.outage_s))
        begun += [(start_s, start_s + length_s) for start_s, length_s in settings.link.script(direction)]
    return max((end_s for start_s, end_s in begun if start_s < settings.seconds), default=0.0)


def _is_number(text: str) -> bool:
    try:
        return isfinite(float(text))
    except ValueError:
        return False


def _stand_in(settings: Settings, user: User) -> User:
    """Return the user with a simulated device of the mass, resolution, friction and force of a hardware's record."""
    if not is_real(user.device):
        return user
    record = make_for(user, seat_axes(settings, user)).capability
    device = (
        f"sim:phantom?resolution_m={record.resolution_m!r}&peak_force_n={record.peak_force_n!r}"
        f"&mass_kg={record.apparent_mass_kg!r}&damping_nspm={record.own_damping_nspm!r}&friction_n={record.own_friction_n!r}"
    )
    return replace(user, device=device)


def checked_change(
    settings: Settings, now: Advice, checked: Check, progress: Callable[[int, int], None] = lambda tried, total: None
) -> Change | None:
    """Return the change that helps most by the model among those that sessions confirm; None for none.

    Confirmed: passive and stable, or judged no worse than before, and the measured felt stiffness nearer to the one asked for;
    a change for a further reach must not take it further away; for fewer warnings it does not count. Its scores hold the
    measured feel. A playout that follows the jitter is tried too, as the model knows no jitter.
    """
    table = to_builtins(settings)
    asked = {user.name: user.asked_npm for user in now.users}
    before = checked.missed(asked)
    tried: Iterable[Change] = islice(ranked_changes(settings, now, progress), MOST_CHANGES)
    found: list[Change] = []
    if settings.playout.frames != "auto" and _draws(settings):
        tried = chain([change_to(settings, now, "playout.frames", "auto")], tried)
    for change in tried:
        after = check(resolve(table, change.overrides))
        fewer = change.after.warnings < change.before.warnings
        missed = after.missed(asked)
        if after.spoils(checked) or "bad" in (after.passive, after.stable):
            continue
        if before is None or missed is None:
            return dataclasses.replace(change, measured=False)
        only_feel = change.after.key()[:2] == change.before.key()[:2]
        if fewer or round(missed, 2) < round(before, 2) + (0.0 if only_feel else 0.01):
            scores = checked.scored(change.before, before), after.scored(change.after, missed)
            found.append(dataclasses.replace(change, before=scores[0], after=scores[1]))
            if change.value != "auto":
                break
    return min(found, key=lambda change: (change.after.warnings, change.after.missed), default=None)


def checked_stiffest(
    settings: Settings, progress: Callable[[int, int], None] = lambda tried, total: None
) -> tuple[Stiffest, Check] | None:
    """Return the stiffest felt session that is passive and stable in the laboratory, too; None where there is none.

    b and K are lowered until a session is; of a coupling that is not passive by construction only stability is required.
    """
    found = stiffest(settings, progress)
    if found is None:
        return None
    for damper_share, stiffness_share in EASED:
        tried = found if damper_share == stiffness_share == 1.0 else eased(found, damper_share, stiffness_share)
        checked = check(tried.settings)
        if checked.stable != "bad" and (checked.passive != "bad" or not_passive(settings)):
            return tried, checked
    return None
