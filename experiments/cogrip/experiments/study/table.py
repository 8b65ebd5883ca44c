"""One tidy table of a study: a row a person and session, with its place in the study, what it set, measures and answers."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cogrip.experiments.study.journal import RUNS, AnswerLine, TrialLine, open_study, read_answers, read_trials
from cogrip.experiments.study.phase_table import phase_rows
from cogrip.experiments.study.plan import CATCH
from cogrip.experiments.study.psychometric import Answered
from cogrip.experiments.study.questions import raw_tlx
from cogrip.experiments.study.staircase import Estimate, estimate
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.trial import begun_by, ended_by
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.schema import unit_of
from cogrip.results.measures.columns import RunColumns, read_columns
from cogrip.results.measures.motion import felt_stiffness_missing
from cogrip.results.measures.registry import MEASURES, measure
from cogrip.results.reading.columns import NUMBER, Column
from cogrip.results.reading.export import Format, open_table
from cogrip.results.reading.folder import SUMMARY

PLACE: tuple[Column, ...] = (
    Column("study", "string"), Column("mode", "string"), Column("group", "int64"), Column("participant", "string"),
    Column("seat", "int64"),
    Column("condition", "string"), Column("block", "string"), Column("trial", "int64"), Column("practice", "int64"),
    Column("repetition", "int64"), Column("interval", "int64"), Column("attempt", "int64"), Column("run", "string"),
    Column("ended", "string"), Column("track", "string"), Column("level", NUMBER), Column("correct", "int64"),
    Column("pauses", "int64"),
)  # fmt: skip
ANSWER = "answer_"
MISSING = "felt_stiffness_missing"  # column that says why a row has no felt stiffness
REDUCED = "effects_reduced_s"  # column that says for how long effects were rendered with less than asked for
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # beginnings of a text that a spreadsheet takes for a formula

Row = dict[str, Any]


class StudyTable(NamedTuple):
    """Rows by column name; notes: runs of which nothing can be measured; empty: measures without values, each with why.

    phases: rows of `phase_table`, none where no trial has phases.
    """

    study: Study
    columns: list[Column]
    rows: list[Row]
    notes: list[str]
    empty: list[str]
    phases: Sequence[Row] = ()


def read_table(path: Path, progress: Callable[[int, int], None] = lambda done, total: None) -> StudyTable:
    """Return the table of a study's folder, of all finished trials. Raises StudyError for another folder."""
    study, _ = open_study(path)
    lines = [line for line in read_trials(path) if line.status == "finished"]
    answers = read_answers(path)
    rows: list[Row] = []
    phases: list[Row] = []
    notes: list[str] = []
    for done, line in enumerate(lines):
        progress(done, len(lines))
        for interval, run in enumerate(line.runs):
            rows += _rows(study, path / RUNS / run, line, interval, answers, notes, phases)
    keys = {key for line in lines for values in line.values for key in values}
    asked = {key for row in rows for key in row if key.startswith(ANSWER)}
    columns = [
        *PLACE,
        *(_column(key, rows) for key in sorted(keys)),
        *(Column(each.name, NUMBER, unit_of(each.name)) for each in MEASURES),
        Column(MISSING, "string"),
        Column(REDUCED, NUMBER, "s"),
        *(_column(key, rows) for key in sorted(asked)),
    ]
    return StudyTable(study, columns, rows, notes, _missing(rows), phases)


def _rows(
    study: Study, folder: Path, line: TrialLine, interval: int, answers: Sequence[AnswerLine], notes: list[str],
    phases: list[Row],
) -> list[Row]:  # fmt: skip
    """Return the rows of a session; what is missing is added to `notes`, the rows of its phases to `phases`."""
    run: RunColumns | None = None
    values = line.values[interval]
    marked = study.start == "button" and line.mode == "live"
    summary = _summary(folder)
    try:
        begun, ended = begun_by(folder.name) if marked else "", ended_by(folder.name, line.ended[interval])
        run = read_columns(folder, study.goal_of(values), _task_s(summary), begun, ended)
        measured: list[Row] = [
            {**measure(run, number), MISSING: felt_stiffness_missing(run, number)} for number in range(len(run.people))
        ]
    except (RecordingError, OSError) as error:
        notes.append(str(error))
        measured = [{} for _ in line.people]
    rows: list[Row] = [
        {
            "study": study.name, "mode": line.mode, "group": line.group + 1, "participant": person, "seat": seat,
            "condition": line.condition, "block": line.block, "trial": line.number, "practice": int(line.practice),
            "repetition": line.repetition + 1, "interval": interval + 1, "attempt": line.attempt, "run": folder.name,
            "ended": line.ended[interval], "track": line.track, "level": line.level,
            "correct": None if line.correct is None else int(line.correct), "pauses": line.pauses,
            **{key: _plain(value) for key, value in values.items()}, **measured[seat], REDUCED: _reduced_s(summary, person),
            **_answers_of(study, line, person, answers),
        }
        for seat, person in enumerate(line.people)
    ]  # fmt: skip
    if run is not None:
        phases += phase_rows(run, rows)
    return rows


def _missing(rows: Sequence[Row]) -> list[str]:
    """Return in how many rows there is no felt stiffness, and why."""
    reasons = Counter(reason for row in rows if (reason := row.get(MISSING)))
    why = "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common())
    return [f"felt_stiffness_npm: none in {reasons.total()} of {len(rows)} rows: {why}"] if reasons else []


def _summary(folder: Path) -> dict[str, Any]:
    """Return the summary of a run, empty where it cannot be read."""
    try:
        found = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _task_s(summary: Mapping[str, Any]) -> float | None:
    """Return when a scene's task was reached, None if it was not, or there is none."""
    task = summary.get("task") or {}
    at_s = task.get("at_s")
    return float(at_s) if task.get("reached") and at_s is not None else None


def _reduced_s(summary: Mapping[str, Any], person: str) -> float | None:
    """Return for how long a person's effects were rendered with less than asked for, None where there were none."""
    told = next((user.get("effects") for user in summary.get("users") or () if user.get("name") == person), None)
    return told.get("reduced_s") if told else None


def _answers_of(study: Study, line: TrialLine, person: str, answers: Sequence[AnswerLine]) -> Row:
    """Return a person's answers to this trial, and at the end of its block; with the raw score of each NASA-TLX."""
    found = {
        each.question: each.answer
        for each in answers
        if (each.group, each.block, each.participant) == (line.group, line.block, person)
        and (each.place, each.attempt) in ((line.place, line.attempt), (-1, 0))
    }
    scores = {name: raw_tlx(found, name) for name, question in study.questions.items() if question.kind == "tlx"}
    return {f"{ANSWER}{name}": value for name, value in {**found, **scores}.items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    return value if isinstance(value, (int, float, str)) else json.dumps(value)


def _column(name: str, rows: Sequence[Row]) -> Column:
    numbers = all(isinstance(row[name], (int, float)) for row in rows if row.get(name) is not None)
    return Column(name, NUMBER, unit_of(name)) if numbers else Column(name, "string")


def write_table(table: StudyTable, to: Format, path: Path) -> None:
    """Write the table as one new file. Raises ExportError, and FileExistsError where there is one."""
    typed = {f"{ANSWER}{name}" for name, each in table.study.questions.items() if each.kind == "text"}
    texts = typed if to == "csv" else set()
    write_columns(
        table.columns, [_values(table.rows, each, text=each.name in texts) for each in table.columns], to, path
    )


def write_columns(columns: Sequence[Column], values: Sequence[Sequence[Any]], to: Format, path: Path) -> None:
    """Write columns with their values as one new file. Raises ExportError, and FileExistsError where there is one."""
    with path.open("xb") as file:
        try:
            out = open_table(to, file, columns)
            out.write(values)
            out.close()
        except BaseException:
            path.unlink()
            raise


def _values(rows: Sequence[Row], column: Column, *, text: bool) -> list[Any]:
    """Return a column. text: typed by people; a spreadsheet is to show, and not to run, what looks like a formula."""
    values = [row.get(column.name) for row in rows]
    if text:
        return [f"'{value}" if str(value).startswith(FORMULA) else value for value in values]
    return [None if value is None else float(value) for value in values] if column.type == NUMBER else values


def thresholds(study: Study, trials: Sequence[TrialLine]) -> dict[tuple[str, str, str], Estimate]:
    """Return the threshold of each (participant, block, condition) with a staircase, from all its tracks and catch trials."""
    found: dict[tuple[str, str, str], Estimate] = {}
    for block in study.blocks:
        if block.staircase is None:
            continue
        answered: dict[tuple[str, str, str], dict[str, list[Answered]]] = {}
        easy: dict[str, list[Answered]] = {}
        for line in trials:
            if line.block != block.name or line.level is None or line.correct is None:
                continue
            if line.track == CATCH:
                easy.setdefault(line.people[0], []).append((line.level, line.correct))
            else:
                tracks = answered.setdefault((line.people[0], block.name, line.condition), {})
                tracks.setdefault(line.track, []).append((line.level, line.correct))
        found |= {
            key: estimate(block.staircase, list(each.values()), easy.get(key[0], ())) for key, each in answered.items()
        }
    return found


def caught(trials: Sequence[TrialLine]) -> dict[tuple[str, str], tuple[int, int]]:
    """Return how many catch trials each (participant, block) answered wrongly, of how many."""
    found: dict[tuple[str, str], tuple[int, int]] = {}
    for line in trials:
        if line.track == CATCH and line.correct is not None:
            wrong, asked = found.get((line.people[0], line.block), (0, 0))
            found[line.people[0], line.block] = wrong + (not line.correct), asked + 1
    return found
