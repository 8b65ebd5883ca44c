"""Simulated participants: they are ready at once, and answer by a psychometric function or by chance, seeded."""

from collections.abc import Sequence
from pathlib import Path
from random import Random

from cogrip.experiments.study.plan import Trial
from cogrip.experiments.study.psychometric import gaussian, weibull
from cogrip.experiments.study.questions import TLX_MOST, TLX_STEP, Answer, Item
from cogrip.experiments.study.study_file import Study, StudyError
from cogrip.experiments.study.trial import TrialEvent, TrialState
from cogrip.results.measures.columns import read_columns
from cogrip.results.measures.registry import BY_NAME


class SimulatedPeople:
    """See `conductor.People`. Which of two intervals had more of a measure they tell by what the runs' recordings hold."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._observer = study.simulated

    def tell(self, text: str, people: Sequence[str]) -> None:
        """Take instructions."""

    def thank(self, people: Sequence[str]) -> None:
        """Go home."""

    def rest(self, seconds: float, people: Sequence[str]) -> None:
        """Need no break."""

    def wait(self, trial: Trial, state: TrialState, people: Sequence[str]) -> TrialEvent:
        """Return READY at once."""
        return TrialEvent.READY

    def answer(self, person: str, item: Item, trial: Trial | None, runs: Sequence[Path]) -> Answer:
        """Return an answer, the same for the same trial of the same study."""
        where = f"{trial.group}/{trial.block.name}/{trial.place}" if trial else ""
        random = Random(f"{self._study.seed}/{person}/{item.name}/{where}/answer")
        rule = trial.block.staircase if trial else None
        if trial is not None and rule is not None and item.name == rule.question:
            return item.question.choices[self._larger(self._felt(person, runs), random)]
        match item.question.kind:
            case "choice":
                return random.choice(item.question.choices)
            case "likert":
                return random.randint(1, item.question.points)
            case "tlx":
                return random.randrange(0, TLX_MOST + 1, TLX_STEP)
            case "text":
                return "simulated"

    def _felt(self, person: str, runs: Sequence[Path]) -> list[float]:
        """Return the measure of each interval."""
        found = []
        for folder in runs:
            columns = read_columns(folder)
            number = next(place for place, each in enumerate(columns.people) if each.name == person)
            value = BY_NAME[self._observer.measure].of(columns, number)
            if value is None:
                raise StudyError(
                    f"simulated.measure = {self._observer.measure!r}: {folder.name} has none; take another, or a longer session"
                )
            found.append(value)
        return found

    def _larger(self, felt: Sequence[float], random: Random) -> int:
        """Return the interval, 0 or 1, that seems to have more."""
        observer = self._observer
        more = felt[1] - felt[0]
        if observer.slope is None:
            right = gaussian(abs(more), observer.threshold, observer.lapse)
        else:
            right = weibull(abs(more), observer.threshold, observer.slope, observer.lapse)
        larger = int(more > 0.0)
        return larger if random.random() < right else 1 - larger
