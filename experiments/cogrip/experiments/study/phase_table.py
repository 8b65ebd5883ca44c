"""Table of a study's phases: a row a person, session and phase, with when it was and the measures of it alone."""

from collections.abc import Sequence
from typing import Any

from cogrip.experiments.study.phases import spells
from cogrip.protocol.recording.schema import unit_of
from cogrip.results.measures.columns import RunColumns
from cogrip.results.measures.registry import MEASURES
from cogrip.results.reading.columns import NUMBER, Column

_MEASURES = [each for each in MEASURES if not each.of_goal]
COLUMNS: tuple[Column, ...] = (
    Column("group", "int64"), Column("participant", "string"), Column("seat", "int64"), Column("condition", "string"),
    Column("block", "string"), Column("trial", "int64"), Column("practice", "int64"), Column("repetition", "int64"),
    Column("interval", "int64"), Column("run", "string"), Column("phase", "string"),
    Column("phase_begin_s", NUMBER, "s"), Column("phase_end_s", NUMBER, "s"),
    *(Column(each.name, NUMBER, unit_of(each.name)) for each in _MEASURES),
)  # fmt: skip


def phase_rows(run: RunColumns, of_trial: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the rows of a session. of_trial: its rows in the table of the study, one a person."""
    found = []
    for spell in spells(of_trial[0]["run"], run.markers, float(run.time_s[-1]) + 1.0 / run.rate_hz):
        part = run.part(spell.begin_s, spell.end_s)
        for person, row in enumerate(of_trial if len(part.time_s) else ()):
            measured = {each.name: each.of(part, person) for each in _MEASURES}
            place = {column.name: row[column.name] for column in COLUMNS if column.name in row}
            when = {"phase": spell.name, "phase_begin_s": spell.begin_s, "phase_end_s": spell.end_s}
            found.append({**place, **when, **measured})
    return found
