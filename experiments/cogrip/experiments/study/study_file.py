"""The TOML schema of a study (docs/studies.md): sessions, conditions, blocks, questions, participants.

`Study.settings_of` gives the settings of one session; `check` tries every condition before anybody comes.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
from msgspec.structs import replace

from cogrip.experiments.study.audio import Audio
from cogrip.experiments.study.orders import Order
from cogrip.experiments.study.phases import Phase, phase_begun, unfit_phases
from cogrip.experiments.study.questions import Question, items_of, unfit_question
from cogrip.experiments.study.spread import unfit_spread
from cogrip.experiments.study.staircase import Staircase, unfit_staircase
from cogrip.experiments.study.trial import begun_by
from cogrip.experiments.study.trigger_codes import unfit_triggers
from cogrip.protocol.foreign_file import ForeignFileError
from cogrip.protocol.settings.effects import EffectSection
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError, readable, refuse_unknown
from cogrip.protocol.settings.types import Name, Seed
from cogrip.results.measures.goal import NO_GOAL, Goal, unfit_goal

GOAL = "goal."  # prefix of keys of conditions that are the goal's, not the session's
EFFECTS = "effects"  # key of a session or condition that names effects of the study
OWN = frozenset({"name", "seed"})  # keys of a session that no condition sets
BASE = "base"  # name of the condition of a study that names none
_MOST_OF_A_GROUP, _MOST_ATTEMPTS = 99_999, 99  # largest numbers of a trial and of an attempt that a marker has room for

Ending = Literal["time", "goal", "operator"]
Start = Literal["key", "button"]


class StudyError(ForeignFileError, ValueError):
    """A study that cannot be run; the text names the key, the value, the bound and the cure."""


class SimulatedObserver(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[simulated]: simulated participants; how they answer questions about two intervals, as psychometric functions have it.

    measure: what they compare; threshold: the difference that they find with probability `psychometric.TARGET`, in its unit;
    slope: of a Weibull function, None: d' grows in proportion to the difference, which no fit assumes.
    begins: phase with which hands begin; before it they stay where they are. "": with the trial.
    spread: by key of a hand, such as delay_s, the standard deviation over participants of its logarithm.
    """

    measure: str = "felt_stiffness_npm"
    threshold: Annotated[float, msgspec.Meta(gt=0.0)] = 50.0
    slope: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] | None = None
    lapse: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.0
    begins: str = ""
    spread: dict[str, Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]] = {}


class StudyEffect(EffectSection, frozen=True, forbid_unknown_fields=True):
    """[effects.NAME]: an effect of the conditions that name it. phase: with which it begins; "": with the trial."""

    phase: str = ""

    def in_run(self, run: str, name: str) -> dict[str, Any]:
        """Return its table in the settings of a run: the run's own markers begin it. name: what the study calls it."""
        table = {name: value for name, value in msgspec.to_builtins(self).items() if name != "phase"}
        return {"marker": phase_begun(run, self.phase) if self.phase else begun_by(run), "name": name, **table}


class Block(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[[blocks]]. conditions: names, () all; ask: after each trial; ask_after: at the end of the block.

    break_every: trials from one break to the next, 0 for none; break_s: how long one lasts; phases: of each of its sessions
    """

    name: Name
    order: Order = "fixed"
    repetitions: Annotated[int, msgspec.Meta(ge=1, le=1000)] = 1
    conditions: tuple[str, ...] = ()
    practice: bool = False
    instructions: str = ""
    ask: tuple[str, ...] = ()
    ask_after: tuple[str, ...] = ()
    break_every: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 0
    break_s: Annotated[float, msgspec.Meta(ge=0.0, le=86_400.0)] = 0.0
    phases: tuple[Phase, ...] = ()
    staircase: Staircase | None = None


class Study(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole study. session: settings over those of the file `settings`; participants: people, or groups of people.

    effects: by name, for `effects` of a session or condition, a list of names in place of [[effects]].
    triggers: codes on the trigger line by event, as in `trigger_codes`; none: all markers, by codes in turn.

    axis: words under the conditions in figures; start: how people say that they are ready, of live sessions.
    """

    name: Name
    participants: Annotated[
        tuple[Name | Annotated[tuple[Name, ...], msgspec.Meta(min_length=1)], ...], msgspec.Meta(min_length=1)
    ]
    blocks: Annotated[tuple[Block, ...], msgspec.Meta(min_length=1)]
    seed: Seed = 1
    settings: str = ""
    session: dict[str, Any] = {}
    instructions: str = ""
    axis: str = ""
    start: Start = "key"
    end: Ending = "time"
    goal: Goal = NO_GOAL
    conditions: dict[Name, dict[str, Any]] = {}
    effects: dict[Name, StudyEffect] = {}
    questions: dict[Name, Question] = {}
    audio: Audio = Audio()
    triggers: dict[str, Annotated[int, msgspec.Meta(ge=1, le=255)]] = {}
    simulated: SimulatedObserver = SimulatedObserver()

    def groups(self) -> list[tuple[str, ...]]:
        """Return the people of each group, in the order of their seats."""
        return [(each,) if isinstance(each, str) else each for each in self.participants]

    def conditions_of(self, block: Block) -> tuple[str, ...]:
        """Return the conditions of a block."""
        return block.conditions or tuple(self.conditions) or (BASE,)

    def changes(self, condition: str) -> dict[str, Any]:
        """Return what a condition sets, by key."""
        return dict(flat(self.conditions.get(condition, {})))

    def goal_of(self, changes: Mapping[str, Any]) -> Goal:
        """Return the goal where these keys are set. Raises StudyError."""
        table = msgspec.to_builtins(self.goal) | {
            key.removeprefix(GOAL): value for key, value in changes.items() if key.startswith(GOAL)
        }
        goal: Goal = _converted(table, Goal, GOAL)
        return goal

    def settings_of(
        self, base: Mapping[str, Any], people: Sequence[str], changes: Mapping[str, Any], seed: int, run: str = ""
    ) -> Settings:
        """Return the settings of a session; users are called as the participants are. Raises SettingsError.

        base: the table of the file `settings`, empty where there is none. run: name of its folder, with which effects begin.
        """
        overrides = {
            **dict(flat(self.session)),
            **{key: each for key, each in changes.items() if not key.startswith(GOAL)},
        }
        if (named := self.effects_of(changes)) is not None:
            overrides[EFFECTS] = [self.effects[name].in_run(run, name) for name in named]
        elif any(key.startswith(f"{EFFECTS}.") for key in changes) and not (base or self.session).get(EFFECTS):
            raise SettingsError(
                'effects: a condition has their names; write [effects.field], and here effects = ["field"]'
            )
        settings = resolve(base or self.session, {**overrides, "name": self.name, "seed": seed})
        if len(settings.users) != len(people):
            raise SettingsError(
                f"participants: a group of {len(people)} ({', '.join(people)}), and the session has {len(settings.users)} "
                "users; give groups of as many"
            )
        users = tuple(replace(user, name=name) for user, name in zip(settings.users, people, strict=True))
        called = dict(zip([user.name for user in settings.users], people, strict=True))
        effects = tuple(replace(each, users=tuple(called[user] for user in each.users)) for each in settings.effects)
        return replace(settings, users=users, effects=effects)

    def effects_of(self, changes: Mapping[str, Any]) -> Sequence[str] | None:
        """Return which effects of the study a session has by name; None where neither it nor its condition names any.

        Raises SettingsError for a name that there is not.
        """
        named = changes.get(EFFECTS, self.session.get(EFFECTS))
        if not isinstance(named, (list, tuple)) or not all(isinstance(name, str) for name in named):
            return None
        for name in named:
            if name not in self.effects:
                raise SettingsError(
                    f"effects: there is no effect {name!r}; there is: {', '.join(self.effects) or 'none'}"
                )
        return named


def flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables by dotted key, those of lists of tables by number: users.0.hand."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        elif isinstance(value, (list, tuple)) and value and all(isinstance(each, Mapping) for each in value):
            for number, each in enumerate(value):
                yield from flat(each, f"{prefix}{key}.{number}.")
        else:
            yield f"{prefix}{key}", value


def read_study(table: dict[str, Any]) -> Study:
    """Return a study from its TOML table. Raises StudyError."""
    for key, kind in (
        ("effects", StudyEffect),
        ("questions", Question),
    ):  # by their names, which an error of the whole leaves out
        named = table.get(key)
        for name, each in named.items() if isinstance(named, dict) else ():
            if isinstance(each, dict):
                _converted(each, kind, f"{key}.{name}.")
    study: Study = _converted(table, Study, "")
    return study


def _converted(table: dict[str, Any], kind: Any, where: str) -> Any:
    try:
        refuse_unknown(table, kind)
        return msgspec.convert(table, kind)
    except SettingsError as error:
        raise StudyError(f"{where}{error}") from None
    except msgspec.ValidationError as error:
        raise StudyError(f"{where}{readable(str(error), table, kind)}") from None


def check(study: Study, base: Mapping[str, Any]) -> list[tuple[str, Settings]]:
    """Return the settings of every condition, for every group, behind the words that name it in an error.

    Raises StudyError or SettingsError for what cannot be run.
    """
    _check_names(study)
    for name, question in study.questions.items():
        if why := unfit_question(question):
            raise StudyError(f"questions.{name}: {why}")
    for block in study.blocks:
        _check_block(study, block)
    found: list[tuple[str, Settings]] = []
    lasts_s: dict[str, float] = {}
    for condition in dict.fromkeys(name for block in study.blocks for name in study.conditions_of(block)):
        changes = study.changes(condition)
        where = f"conditions.{condition}: " if study.conditions else ""
        if own := next((key for key in changes if key in OWN), ""):
            raise StudyError(f"{where}{own} is the study's own; leave it out")
        for people in study.groups():
            try:
                settings = study.settings_of(base, people, changes, study.seed)
                why = unfit_goal(goal := study.goal_of(changes), settings.object.axes)
            except (SettingsError, StudyError) as error:
                raise StudyError(f"{where}{error}") from None
            if why:
                raise StudyError(f"{where}{why}")
            if study.end == "goal" and not (goal.stated or settings.task.stated):
                raise StudyError(
                    f'{where}end = "goal", and there is none; give goal.place_m and goal.within_m, or a [task]'
                )
            found.append((where, settings))
            lasts_s[condition] = settings.seconds
    if why := unfit_triggers(study.triggers, {phase.name for block in study.blocks for phase in block.phases}):
        raise StudyError(f"triggers.{why}")
    _check_phases(study, lasts_s)
    _check_effects(study)
    _check_levels(study, base)
    if why := unfit_spread(study.simulated.spread, {user.hand for _, each in found for user in each.users}):
        raise StudyError(why)
    return found


def _check_names(study: Study) -> None:
    people = [name for group in study.groups() for name in group]
    items = [item.name for name, question in study.questions.items() for item in items_of(name, question)]
    for what, names in (
        ("participants", people), ("blocks", [block.name for block in study.blocks]), ("questions", items),
    ):  # fmt: skip
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise StudyError(f"{what}: {twice} is named twice; give each one name")


def _check_block(study: Study, block: Block) -> None:
    where = f"blocks.{block.name}: "
    for known, names, what in (
        (study.conditions, block.conditions, "condition"), (study.questions, (*block.ask, *block.ask_after), "question"),
    ):  # fmt: skip
        for name in names:
            if name not in known:
                there = ", ".join(known) or "none"
                raise StudyError(f"{where}there is no {what} {name!r}; there is: {there}")
    asked = {*block.ask, *([block.staircase.question] if block.staircase else [])}  # after each trial
    if twice := asked & set(block.ask_after):
        raise StudyError(
            f"{where}{twice.pop()!r} is in ask and in ask_after; ask it at one of them, or name another question"
        )
    if (block.break_every > 0) != (block.break_s > 0.0):
        raise StudyError(f"{where}break_every and break_s go together; give both, or neither")
    if (block.order == "staircase") != (block.staircase is not None):
        raise StudyError(f'{where}order = "staircase" and [blocks.staircase] go together; give both, or neither')
    if block.staircase is None:
        return
    if block.staircase.catch_every == 1:
        raise StudyError(
            f"{where}staircase.catch_every = 1 leaves no trial to the staircase; give 2 or more, or 0 for none"
        )
    if why := unfit_staircase(block.staircase):
        raise StudyError(f"{where}staircase: {why}")
    question = study.questions.get(block.staircase.question)
    if question is None or question.kind != "choice" or len(question.choices) != 2:
        raise StudyError(
            f"{where}staircase.question = {block.staircase.question!r} must name a choice of two, the first interval and "
            "the second; add it to [questions]"
        )


def _check_phases(study: Study, lasts_s: Mapping[str, float]) -> None:
    for block in study.blocks:
        run = run_name(len(study.groups()), _MOST_OF_A_GROUP, block.name, _MOST_ATTEMPTS, "b")
        for condition in study.conditions_of(block):
            if why := unfit_phases(block.phases, lasts_s[condition], run):
                where = f" with condition {condition}" if study.conditions else ""
                raise StudyError(f"blocks.{block.name}: phases{where}: {why}")
    known = dict.fromkeys(phase.name for block in study.blocks for phase in block.phases)
    if study.simulated.begins and study.simulated.begins not in known:
        there = ", ".join(known) or "none"
        raise StudyError(f"simulated.begins: no block has a phase {study.simulated.begins!r}; there is: {there}")


def _check_effects(study: Study) -> None:
    for block in study.blocks:
        known = [phase.name for phase in block.phases]
        for condition in study.conditions_of(block):
            for name in study.effects_of(study.changes(condition)) or ():
                if (phase := study.effects[name].phase) and phase not in known:
                    raise StudyError(
                        f"effects.{name}: phase = {phase!r}, and blocks.{block.name} has none of that name; there is: "
                        f"{', '.join(known) or 'none'}"
                    )


def run_name(group: int, number: int, block: str, attempt: int, interval: str) -> str:
    """Return the name of a session's run folder. interval: "a" or "b" of a trial of two sessions, else ""."""
    return f"{group:02}-{number:03}-{block}-{attempt}{interval}".replace(" ", "+")


def _check_levels(study: Study, base: Mapping[str, Any]) -> None:
    for rule in (block.staircase for block in study.blocks if block.staircase is not None):
        for level in (0.0, rule.least, rule.most):
            try:
                study.settings_of(base, study.groups()[0], {rule.key: rule.reference + level}, study.seed)
            except SettingsError as error:
                raise StudyError(f"staircase: {rule.key} = {rule.reference + level:g}: {error}") from None
