"""A study as a data set of BIDS (Brain Imaging Data Structure 1.10): motion of each person, events, measures, answers.

    dataset_description.json, README.md, participants.tsv and .json, task-TASK_events.json, task-TASK_beh.json
    sub-01/motion/sub-01_task-TASK_tracksys-cogrip_run-1_motion.tsv, .json, _channels.tsv     a sample a device tick
    sub-01/motion/sub-01_task-TASK_run-1_events.tsv                                           trial, phases, markers
    sub-01/beh/sub-01_task-TASK_beh.tsv                                                       a row a session: measures, answers

People are sub-01, sub-02 ... in the order of the study's file: no name of theirs is in the data set, nor what they typed.
"""

import json
import re
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cogrip.experiments.study.journal import RUNS, TrialLine, read_trials
from cogrip.experiments.study.phases import spells
from cogrip.experiments.study.study_file import Study
from cogrip.experiments.study.table import ANSWER, MISSING, StudyTable
from cogrip.experiments.study.trial import begun_by, ended_by
from cogrip.experiments.study.trigger_codes import code_of, codes_of_run, words_of
from cogrip.protocol.axes import GRIP_AXES, PLACES, POSE_AXES
from cogrip.protocol.recording.reader import RecordingError
from cogrip.protocol.recording.schema import described
from cogrip.results.reading.columns import Array
from cogrip.results.reading.export import ExportError
from cogrip.results.reading.records import End, RunRecords, open_run

BIDS_VERSION = "1.10.0"
WRITTEN_S = 1.0  # longest time from a marker to its code on the line: what comes later is another one's
NONE = "n/a"  # word of the standard for a value that there is not
_SYSTEM = "cogrip"  # name of the tracking system
_AXES = ("x", "y", "z")
_QUATERNION = ("quat_w", "quat_x", "quat_y", "quat_z")
_KINDS = ("ACCEL", "ANGACCEL", "GYRO", "JNTANG", "LATENCY", "MAGN", "MISC", "ORNT", "POS", "VEL")  # types of channels
_NOT_TOLD = (
    "study",
    "mode",
    "group",
    "participant",
    "run",
    MISSING,
)  # columns of the table that a data set has elsewhere
EVENT_COLUMNS = {
    "onset": ("s", "time from the first sample of the motion file of the same run"),
    "duration": ("s", "duration of the trial or phase, 0 of a marker"),
    "trial_type": ("", "condition of the trial, name of the phase, or text of the marker"),
    "event": ("", "kind of the event: trial, phase or marker"),
    "condition": ("", "condition of the trial"), "block": ("", "block of the trial"),
    "trial": ("", "number of the trial in its group"), "repetition": ("", "repetition of the condition"),
    "practice": ("", "1: a trial for practice"),
    "value": ("", "code on the trigger line; without a trigger_latency the one that the study gives the event"),
    "trigger_latency": ("s", "time from the event until the code was written to the trigger line"),
}  # fmt: skip


class Channel(NamedTuple):
    """Column of a motion file, as BIDS describes it."""

    name: str
    component: str
    type: str
    point: str
    units: str
    values: Array


class WrittenBids(NamedTuple):
    """people, sessions: in how many files of motion; notes: what is missing, and why."""

    people: int
    sessions: int
    notes: list[str]


def pseudonyms(study: Study) -> dict[str, str]:
    """Return the label of each participant by name, in the order of the study's file."""
    people = [name for group in study.groups() for name in group]
    digits = max(2, len(str(len(people))))
    return {name: f"{number:0{digits}}" for number, name in enumerate(dict.fromkeys(people), 1)}


def write_bids(path: Path, table: StudyTable, out: Path) -> WrittenBids:
    """Write the study in the folder `path`, whose table is given, as the new folder `out`.

    Raises ExportError where something is in the way, and OSError; what it had begun is then removed.
    """
    if out.exists():
        raise ExportError(f"{out} exists, and nothing is overwritten; remove it, or name another folder")
    try:
        return _Writer(path, table, out).write()
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise


class _Writer:
    """One data set."""

    def __init__(self, path: Path, table: StudyTable, out: Path) -> None:
        self._path, self._table, self._study, self._out = path, table, table.study, out
        self._labels = pseudonyms(table.study)
        self._task = re.sub(r"[^A-Za-z0-9]", "", table.study.name) or "task"
        self._runs = dict.fromkeys(self._labels, 0)  # sessions so far
        self._notes: list[str] = []

    def write(self) -> WrittenBids:
        lines = [line for line in read_trials(self._path) if line.status == "finished"]
        self._out.mkdir(parents=True)
        self._write_head(lines)
        for line in lines:
            for interval, name in enumerate(line.runs):
                self._write_session(line, interval, self._path / RUNS / name)
        self._write_measures()
        sessions = [count for count in self._runs.values() if count]
        return WrittenBids(len(sessions), int(np.sum(sessions)), self._notes)

    def _write_head(self, lines: Sequence[TrialLine]) -> None:
        took_part = {person for line in lines for person in line.people}
        simulated = all(line.mode == "simulated" for line in lines)
        self._json("dataset_description.json", {
            "Name": self._told(self._study.name) + (" (rehearsal with simulated participants)" if simulated else ""),
            "BIDSVersion": BIDS_VERSION, "DatasetType": "raw",
            "GeneratedBy": [{"Name": "cogrip", "Version": version("cogrip"), "Description": "cogrip export --to bids"}],
        })  # fmt: skip
        self._text("README.md", _readme(self._told(self._study.name), self._told(self._study.instructions), simulated))
        seats = {
            name: (group, seat)
            for group, people in enumerate(self._study.groups(), 1)
            for seat, name in enumerate(people)
        }
        rows = [(f"sub-{label}", *seats[name]) for name, label in self._labels.items() if name in took_part]
        self._tsv("participants.tsv", ("participant_id", "group", "seat"), rows)
        self._json("participants.json", {
            "group": {"Description": "group of people who took part together"},
            "seat": {"Description": "seat in the group, from 0"},
        })  # fmt: skip
        self._json(f"task-{self._task}_events.json", {
            name: {"Description": text, **({"Units": unit} if unit else {})} for name, (unit, text) in EVENT_COLUMNS.items()
        })  # fmt: skip

    def _write_session(self, line: TrialLine, interval: int, folder: Path) -> None:
        try:
            run = open_run(folder)
        except (RecordingError, OSError) as error:
            self._notes.append(self._told(str(error)))
            return
        for person in line.people:
            label, end = self._labels[person], run.clients.get(person)
            if end is None:
                self._notes.append(
                    f"sub-{label}: {folder.name} has no recording of this person's client; cogrip merge brings it"
                )
                continue
            self._runs[person] += 1
            stem = f"sub-{label}/motion/sub-{label}_task-{self._task}"
            number = f"run-{self._runs[person]}"
            columns = end.columns("tick")
            times = columns["time_s"]
            self._write_motion(f"{stem}_tracksys-{_SYSTEM}_{number}", columns, end)
            span_s = float(times[0]), float(times[-1]) + 1.0 / end.rate_hz
            rows = [
                *_events(run, line, interval, codes_of_run(self._study.triggers, folder.name), span_s, self._labels)
            ]
            told = [(*row[:2], self._told(row[2]), *row[3:]) for row in sorted(rows, key=lambda row: (row[0], -row[1]))]
            self._tsv(f"{stem}_{number}_events.tsv", [*EVENT_COLUMNS], told)

    def _write_motion(self, stem: str, columns: Mapping[str, Array], end: End) -> None:
        rate_hz = end.rate_hz
        channels = [*_channels(columns)]
        path = self._out / f"{stem}_motion.tsv"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", encoding="utf-8", newline="\n") as file:
            for row in zip(*[channel.values.tolist() for channel in channels], strict=True):
                file.write("\t".join(map(_cell, row)) + "\n")
        head = ("name", "component", "type", "tracked_point", "units", "sampling_frequency")
        self._tsv(f"{stem}_channels.tsv", head, [(*channel[:5], rate_hz) for channel in channels])
        times = columns["time_s"]
        span_s = float(times[-1] - times[0])
        counts = {f"{kind}ChannelCount": len([each for each in channels if each.type == kind]) for kind in _KINDS}
        self._json(f"{stem}_motion.json", {
            "TaskName": self._task, "Instructions": self._told(self._study.instructions) or NONE,
            "ManufacturersModelName": _device(end),
            "SamplingFrequency": rate_hz, "SamplingFrequencyEffective": (len(times) - 1) / span_s if span_s else rate_hz,
            "RecordingDuration": span_s, "MotionChannelCount": len(channels), **counts,
            "TrackedPointsCount": len({each.point for each in channels} - {NONE}), "TrackingSystemName": _SYSTEM,
            "MissingValues": NONE, "SoftwareVersions": version("cogrip"),
        })  # fmt: skip

    def _write_measures(self) -> None:
        typed = {f"{ANSWER}{name}" for name, each in self._study.questions.items() if each.kind == "text"}
        told = [each.name for each in self._table.columns if each.name not in _NOT_TOLD and each.name not in typed]
        for person, label in self._labels.items():
            rows = [row for row in self._table.rows if row["participant"] == person]
            if rows:
                name = f"sub-{label}/beh/sub-{label}_task-{self._task}_beh.tsv"
                self._tsv(name, told, [[self._plain(row.get(column)) for column in told] for row in rows])
        units = {each.name: each.unit for each in self._table.columns}
        sidecar: dict[str, Any] = {"TaskName": self._task}
        for name in told:
            sidecar[name] = {"Description": described(name) or name} | ({"Units": units[name]} if units[name] else {})
        self._json(f"task-{self._task}_beh.json", sidecar)

    def _plain(self, value: Any) -> Any:
        return self._told(value) if isinstance(value, str) else value

    def _told(self, text: str) -> str:
        """Return a text with labels in the place of names."""
        return without_names(text, self._labels)

    def _tsv(self, name: str, head: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        self._text(name, "".join("\t".join(map(_cell, row)) + "\n" for row in (head, *rows)))

    def _json(self, name: str, content: Mapping[str, Any]) -> None:
        self._text(name, json.dumps(content, indent=2, ensure_ascii=False) + "\n")

    def _text(self, name: str, text: str) -> None:
        path = self._out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8", newline="\n")


def _device(end: End) -> str:
    """Return family and model of the device that a client held."""
    try:
        record = json.loads(end.recording.header.start)["capability"]
        return f"{record['family']}:{record['model']}"
    except (ValueError, KeyError, TypeError):
        return NONE


def _channels(columns: Mapping[str, Array]) -> Iterator[Channel]:
    """Yield the channels of a client's ticks."""
    times = columns["time_s"]
    yield Channel("latency", NONE, "LATENCY", NONE, "s", times - times[0])
    for field, called, kind, point, unit in (
        ("position_m", "position", "POS", "hand", "m"), ("velocity_mps", "velocity", "VEL", "hand", "m/s"),
        ("force_n", "force", "MISC", "hand", "N"), ("object_m", "position", "POS", "object", "m"),
    ):  # fmt: skip
        values = columns[field]
        values = values if values.ndim > 1 else values[:, np.newaxis]
        for place, axis in enumerate(_AXES[: min(PLACES, values.shape[1])]):
            yield Channel(f"{point}_{called}_{axis}", axis, kind, point, unit, values[:, place])
        if values.shape[1] == GRIP_AXES:
            yield Channel(f"{point}_{called}_opening", NONE, "MISC", point, unit, values[:, PLACES])
        if values.shape[1] == POSE_AXES:
            turning = {"m": "rad", "m/s": "rad/s", "N": "N m"}[unit]
            for place, axis in enumerate(_AXES):
                yield Channel(f"{point}_{called}_r{axis}", axis, "MISC", point, turning, values[:, PLACES + place])
    turned = columns.get("orientation")
    if turned is not None and turned.ndim > 1 and np.isfinite(turned).any():
        for place, component in enumerate(_QUATERNION):
            yield Channel(f"hand_{component}", component, "ORNT", "hand", NONE, turned[:, place])


def without_names(text: str, labels: Mapping[str, str]) -> str:
    """Return a text with labels in the place of names, whatever their case; a name within a word is no name."""
    plain = {_plain_name(name).casefold(): label for name, label in labels.items()}
    names = "|".join(re.escape(name) for name in sorted(plain, key=len, reverse=True))
    whole = re.compile(rf"(?<![A-Za-z0-9])(?:{names})(?![A-Za-z0-9])", re.IGNORECASE)
    return whole.sub(lambda match: f"sub-{plain[match[0].casefold()]}", _plain_name(text))


def _plain_name(text: str) -> str:
    return " ".join(text.split())


def _events(
    run: RunRecords,
    line: TrialLine,
    interval: int,
    codes: Mapping[str, int],
    span_s: tuple[float, float],
    names: Collection[str],
) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a session's events: the trial itself, its phases, and every other marker.

    A marker has the code that was written, else the one that the study gives it.
    """
    markers, name, (first_s, last_s) = run.markers(), line.runs[interval], span_s
    triggers = [(said.partition("marker: ")[2], code, time_s) for time_s, code, said in run.triggers()]
    begin, end = begun_by(name), ended_by(name, line.ended[interval])
    place = line.condition, line.block, line.number, line.repetition + 1, int(line.practice)

    def row(time_s: float, until_s: float, kind: str, event: str, marker: str) -> tuple[Any, ...]:
        written = [
            (c, s) for said, c, s in triggers if words_of(marker, names) == said and 0.0 <= s - time_s <= WRITTEN_S
        ]
        code, written_s = written[0] if written else (code_of(codes, words_of(marker, names)), None)
        latency_s = None if written_s is None else written_s - time_s
        return time_s - first_s, until_s - time_s, kind, event, *place, code, latency_s

    begin_s = next((time_s for time_s, text in markers if text.endswith(begin)), first_s)
    end_s = next((time_s for time_s, text in markers if text.endswith(end)), last_s)
    yield row(begin_s, end_s, line.condition, "trial", begin)
    phases = spells(name, markers, end_s)
    for spell in phases:
        yield row(spell.begin_s, spell.end_s, spell.name, "phase", f"phase {name} {spell.name}")
    for time_s, text in markers:
        if not text.endswith(begin) and not text.startswith(f"phase {name} "):
            yield row(time_s, time_s, "end" if text.endswith(end) else text, "marker", text)


def _cell(value: Any) -> str:
    """Return a value as BIDS writes it."""
    if value is None or value == "" or (isinstance(value, float) and not isfinite(value)):
        return NONE
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else " ".join(str(value).split())


def _readme(name: str, instructions: str, simulated: bool) -> str:
    who = "Participants are simulated: this is a rehearsal." if simulated else "People took part, under labels."
    return f"""# {name}

{who} {instructions}

Written by `cogrip export --to bids`. Each person's hand, its velocity, the force on it and the object as the person's client
knew it are motion data, one run a session, at the rate of the device's loop; events are in seconds from the first sample of
that run. Forces are channels of type MISC, as the standard has none for them. Positions of a hand are in its device's own
frame, those of the object in the object's. A row of `beh` is a session, in the order of the runs, with what it set, its
measures and answers; texts that people typed are left out.
"""
