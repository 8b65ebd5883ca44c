"""Conductor of a study: one trial after the other, each through its state machine, what is over into the journal.

It knows neither sessions nor people: both are handed in, in virtual time or live.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from cogrip.experiments.study.journal import RUNS, AnswerLine, StudyFolder, TrialLine
from cogrip.experiments.study.phases import Phase
from cogrip.experiments.study.plan import Done, Trial, next_trial, planned
from cogrip.experiments.study.questions import Answer, Item, items_of
from cogrip.experiments.study.study_file import Block, Study, run_name
from cogrip.experiments.study.trial import TrialEvent, TrialState
from cogrip.machine.addition import add_integers
from cogrip.protocol.settings.sections import Settings
from cogrip.results.measures.goal import Goal

MOST_FAILURES = 3  # most failures of one trial, one after the other

Answers = Mapping[str, Answer]


class Quit(Exception):  # noqa: N818 (a request, not an error)
    """The operator ends for today: the trial that was going on is begun again next time."""


class TrialEnded(NamedTuple):
    """The end of a session. how: time, goal, operator, or why it failed."""

    event: TrialEvent
    how: str


class Sessions(Protocol):
    """Runs sessions."""

    def run(self, settings: Settings, folder: Path, goal: Goal, phases: Sequence[Phase]) -> TrialEnded:
        """Run one to its end, its files in `folder`, which does not exist yet. phases: of which each is marked and shown."""


class People(Protocol):
    """Participants, and the operator. Each method may raise Quit."""

    def tell(self, text: str, people: Sequence[str]) -> None:
        """Show these people instructions, until they have read them."""

    def rest(self, seconds: float, people: Sequence[str]) -> None:
        """Let these people rest for so long; the operator may end it."""

    def wait(self, trial: Trial, state: TrialState, people: Sequence[str]) -> TrialEvent:
        """Wait for READY from everybody, or for the operator; while paused for RESUME or ABANDON."""

    def answer(self, person: str, item: Item, trial: Trial | None, runs: Sequence[Path]) -> Answer:
        """Return a person's answer. trial: None at the end of a block. runs: of the trial's sessions."""

    def thank(self, people: Sequence[str]) -> None:
        """Tell these people that they have done all of it."""


class Conducted(NamedTuple):
    """Counts of trials in all that are finished and abandoned, and of those run now; whether nothing is left."""

    finished: int
    abandoned: int
    now: int
    complete: bool


class Conductor:
    """See above. utc: the time of day for the journal; progress: called with trials done and planned of the group."""

    def __init__(
        self, study: Study, base: Mapping[str, Any], folder: StudyFolder, sessions: Sessions, people: People,
        utc: Callable[[], str] = lambda: "", progress: Callable[[int, int, int], None] = lambda group, done, planned: None,
    ) -> None:  # fmt: skip
        self._study, self._base, self._folder = study, base, folder
        self._sessions, self._people = sessions, people
        self._utc, self._progress = utc, progress
        self._now = 0

    def run(self, groups: Sequence[int]) -> Conducted:
        """Run all trials of these groups that are not over yet."""
        complete = True
        try:
            for group in groups:
                self._run_group(group)
        except Quit:
            complete = False
        over = [line.status for line in self._folder.trials if line.over]
        return Conducted(over.count("finished"), over.count("abandoned"), self._now, complete)

    def _run_group(self, group: int) -> None:
        study, folder = self._study, self._folder
        people = study.groups()[group]
        total = planned(study, group)
        self._progress(group, len(folder.done(group)), total)
        told: Block | None = None
        while True:
            done = folder.done(group)
            trial = next_trial(study, group, done)
            self._ask_after_blocks(group, people, None if trial is None else trial.block)
            if trial is None:
                self._people.thank(people)
                return
            if told is None and not done and study.instructions:
                self._people.tell(study.instructions, people)
            if trial.block is not told and trial.block.instructions:
                self._people.tell(trial.block.instructions, people)
            if told is trial.block:  # whoever comes back later has rested
                self._rest(trial.block, done, people)
            told = trial.block
            self._run_trial(trial, people)
            self._now += 1
            self._progress(group, len(folder.done(group)), total)

    def _rest(self, block: Block, done: Sequence[Done], people: Sequence[str]) -> None:
        """Let people rest where a break is due before the next trial of the block."""
        over = add_integers(each.block == block.name for each in done)
        if block.break_every and over and over % block.break_every == 0:
            self._people.rest(block.break_s, people)

    def _ask_after_blocks(self, group: int, people: Sequence[str], until: Block | None) -> None:
        """Ask what is to be asked at the end of each block before `until` (None: of all), and was not answered yet."""
        for block in self._study.blocks:
            if block is until:
                return
            for person in people:
                known = self._folder.answered(group, block.name, person)
                for item in self._items(block.ask_after):
                    if item.name not in known:
                        answer = self._people.answer(person, item, None, ())
                        self._folder.add_answer(self._answer_line(group, person, block, -1, 0, item, answer))

    def _run_trial(self, trial: Trial, people: Sequence[str]) -> None:
        state = TrialState(len(trial.presentations), people, self._folder.attempts(trial) + 1)
        runs: list[Path] = []
        ended: list[str] = []
        begun = failures = 0
        while not state.over:
            if state.session == 0 and state.state == "waiting":
                runs, ended = [], []
            if state.state == "asking":
                correct = self._ask(trial, people, state, runs)
                state.handle(TrialEvent.ANSWERED)
                self._folder.add_trial(self._line("finished", trial, people, state, runs, ended, correct))
                return
            event = self._people.wait(trial, state, people)
            if event is not TrialEvent.READY:
                state.handle(event)
                continue
            if begun != state.attempt:
                begun = state.attempt
                self._folder.add_trial(self._line("begun", trial, people, state))
            for person in people:
                state.ready(person)
            outcome = self._run_session(trial, people, state, runs)
            ended.append(outcome.how)
            if outcome.event is TrialEvent.FAILED:
                failures += 1
                self._folder.add_trial(self._line("failed", trial, people, state, runs, ended, reason=outcome.how))
                if failures == MOST_FAILURES:
                    raise Quit
            state.handle(outcome.event)
        self._folder.add_trial(self._line("abandoned", trial, people, state, runs, ended))

    def _run_session(self, trial: Trial, people: Sequence[str], state: TrialState, runs: list[Path]) -> TrialEnded:
        shown = trial.presentations[state.session]
        goal = self._study.goal_of(shown.changes)
        interval = "ab"[state.session] if len(trial.presentations) > 1 else ""
        name = run_name(trial.group + 1, trial.number, trial.block.name, state.attempt, interval)
        settings = self._study.settings_of(self._base, people, shown.changes, shown.seed, name)
        folder = self._folder.path / RUNS / name
        runs.append(folder)
        return self._sessions.run(settings, folder, goal, trial.block.phases)

    def _items(self, names: Sequence[str]) -> list[Item]:
        return [item for name in dict.fromkeys(names) for item in items_of(name, self._study.questions[name])]

    def _ask(self, trial: Trial, people: Sequence[str], state: TrialState, runs: Sequence[Path]) -> bool | None:
        """Ask everybody, the first one of a staircase its question too. Return whether that was answered right."""
        correct = None
        for place, person in enumerate(people):
            rule = trial.block.staircase
            first = (rule.question,) if rule is not None and place == 0 else ()
            for item in self._items((*first, *trial.block.ask)):
                answer = self._people.answer(person, item, trial, runs)
                if rule is not None and item.name == rule.question and place == 0:
                    correct = item.question.choices.index(str(answer)) == trial.right
                self._folder.add_answer(
                    self._answer_line(trial.group, person, trial.block, trial.place, state.attempt, item, answer)
                )
        return correct

    def _answer_line(
        self, group: int, person: str, block: Block, place: int, attempt: int, item: Item, answer: Answer
    ) -> AnswerLine:
        return AnswerLine(group, person, block.name, place, attempt, item.name, answer, self._utc())

    def _line(
        self, status: Any, trial: Trial, people: Sequence[str], state: TrialState, runs: Sequence[Path] = (),
        ended: Sequence[str] = (), correct: bool | None = None, reason: str = "",
    ) -> TrialLine:  # fmt: skip
        return TrialLine(
            status=status, group=trial.group, people=tuple(people), number=trial.number, block=trial.block.name,
            place=trial.place, attempt=state.attempt, condition=trial.condition, repetition=trial.repetition,
            practice=trial.block.practice, runs=tuple(run.name for run in runs), ended=tuple(ended),
            values=tuple(dict(each.changes) for each in trial.presentations), track=trial.track, level=trial.level,
            right=trial.right, correct=correct, pauses=state.pauses, reason=reason, utc=self._utc(), mode=self._folder.mode,
        )  # fmt: skip
