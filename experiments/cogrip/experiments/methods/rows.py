"""The sessions of a comparison, by network and method, for its plots."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from cogrip.experiments.experiment import Result
from cogrip.experiments.methods.looks import WORDS
from cogrip.experiments.methods.measures import Mark, State, mark_of, state_of
from cogrip.experiments.methods.query import ComparisonQuery
from cogrip.results.reading.summary_values import is_number

WIDTH = 0.8  # share of a network's room that its methods take
Key = tuple[str, str]  # names of a network and a method


class SessionRows(NamedTuple):
    """One session that was run."""

    seed: int
    measures: Mapping[str, Any]

    @property
    def state(self) -> State:
        return state_of(self.measures)

    @property
    def mark(self) -> Mark:
        return mark_of(self.measures)

    @property
    def seconds(self) -> float:
        """Its length [s], up to where it diverged."""
        return float(self.measures["trace"]["seconds"])

    @property
    def forces(self) -> list[list[float]]:
        """The sketched force on each person [N]."""
        found: list[list[float]] = self.measures["trace"]["force_n"]
        return found


def _severity(session: SessionRows) -> tuple[int, float]:
    return -list(WORDS).index(session.state), session.measures["peak_force_n"] or 0.0


class Rows:
    """The results of the sessions that could be run, by network, method and measure; `summary` has the rows of `gather`."""

    def __init__(self, asked: ComparisonQuery, results: Mapping[int, Result], summary: Mapping[str, Any]) -> None:
        self.asked = asked
        self.summary: dict[Key, Mapping[str, Any]] = {(row["network"], row["method"]): row for row in summary["rows"]}
        self._sessions: dict[Key, list[SessionRows]] = {key: [] for key in self.summary}
        for case, result in sorted(results.items()):
            values = asked.values(case)
            if not result.error:
                session = SessionRows(values["seed"], result.measures)
                self._sessions[values["network"], values["method"]].append(session)

    def typical(self, key: Key) -> SessionRows | None:
        """Return the median session of those whose forces were kept: by its state, then its peak force.

        Of an even number it is the lower one of the middle two.
        """
        kept = [session for session in self._sessions[key] if session.measures.get("trace")]
        return sorted(kept, key=_severity)[(len(kept) - 1) // 2] if kept else None

    def counts(self, key: Key) -> Counter[tuple[State, Mark]]:
        """Return the number of sessions of each stability and passivity."""
        return Counter((session.state, session.mark) for session in self._sessions[key])

    def judged(self, key: Key, measure: str) -> list[tuple[float, Mark]]:
        """Return each number, and its session's verdicts."""
        return [
            (float(session.measures[measure]), session.mark)
            for session in self._sessions[key]
            if is_number(session.measures[measure])
        ]

    def numbers(self, measure: str) -> list[float]:
        """Return every number of a measure."""
        return [value for key in self.summary for value, _ in self.judged(key, measure)]

    def places(self) -> Iterator[tuple[Key, float]]:
        """Yield network and method, and the method's place on the axis."""
        count = len(self.asked.methods)
        for network, name in enumerate(self.asked.networks):
            for number, method in enumerate(self.asked.methods):
                yield (name, method), network + WIDTH * ((number + 0.5) / count - 0.5)
