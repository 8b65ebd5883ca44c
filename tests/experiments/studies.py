"""Studies in memory for tests: sessions that leave no files, and participants who answer by what was asked for."""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cogrip.experiments.study.conductor import Conducted, Conductor, Ended
from cogrip.experiments.study.journal import StudyFolder
from cogrip.experiments.study.laboratory_trial import LaboratorySessions
from cogrip.experiments.study.phases import Phase
from cogrip.experiments.study.simulated import SimulatedPeople
from cogrip.experiments.study.study_file import Study, check, read_study
from cogrip.experiments.study.trial import Event
from cogrip.protocol.settings.sections import Settings
from cogrip.results.measures.goal import Goal

SHIPPED = Path(__file__).parents[2] / "configs" / "studies"

PLAIN = """
name = "plain"
participants = ["P01", "P02"]
[session]
seconds = 0.1
[conditions.a]
coupling.stiffness_npm = 500.0
[conditions.b]
coupling.stiffness_npm = 600.0
[questions.sure]
kind = "likert"
text = "How sure?"
[questions.load]
kind = "tlx"
[questions.wider]
kind = "choice"
text = "Which?"
choices = ["first", "second"]
[[blocks]]
name = "one"
order = "latin"
repetitions = 2
ask = ["sure"]
ask_after = ["load"]
[[blocks]]
name = "two"
order = "staircase"
conditions = ["a"]
[blocks.staircase]
key = "coupling.damping_nspm"
reference = 10.0
start = 4.0
least = 0.1
most = 20.0
trials = 6
catch_every = 0
question = "wider"
"""


def parsed(text: str, **changes: Any) -> Study:
    """Return a study that was checked, with other values of some of its keys."""
    study = read_study({**tomllib.loads(text), **changes})
    check(study, {})
    return study


def shipped(name: str, **changes: Any) -> Study:
    return parsed((SHIPPED / f"{name}.toml").read_text(encoding="utf-8"), **changes)


class NoSessions:
    """Sessions that end at once. asked: the settings of each, by its folder's name; outcomes: of the first ones."""

    def __init__(self, outcomes: Sequence[Ended] = ()) -> None:
        self.asked: dict[str, Settings] = {}
        self._outcomes = list(outcomes)

    def run(self, settings: Settings, folder: Path, goal: Goal, phases: Sequence[Phase]) -> Ended:
        assert folder.name not in self.asked, "a run folder is made once"
        self.asked[folder.name] = settings
        return self._outcomes.pop(0) if self._outcomes else Ended(Event.ENDED, "time")


class Observers(SimulatedPeople):
    """Simulated participants who feel the damping exactly as asked for."""

    def __init__(self, study: Study, sessions: NoSessions) -> None:
        super().__init__(study)
        self._sessions = sessions

    def _felt(self, person: str, runs: Sequence[Path]) -> list[float]:
        return [self._sessions.asked[run.name].coupling.damping_nspm for run in runs]


def conducted(
    study: Study, path: Path, sessions: NoSessions | None = None, groups: Sequence[int] | None = None
) -> tuple[Conducted, StudyFolder]:
    """Run a study without sessions."""
    sessions, folder = sessions or NoSessions(), StudyFolder(path, study, {})
    groups = range(len(study.groups())) if groups is None else groups
    return Conductor(study, {}, folder, sessions, Observers(study, sessions)).run(groups), folder


def run_in_laboratory(study: Study, path: Path, groups: Sequence[int] = (0,)) -> StudyFolder:
    """Run a study in virtual time, with simulated participants."""
    folder = StudyFolder(path, study, {})
    sessions = LaboratorySessions(study)
    outcome = Conductor(study, {}, folder, sessions, SimulatedPeople(study)).run(groups)
    assert outcome.complete
    assert not outcome.abandoned
    return folder
