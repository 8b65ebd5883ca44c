"""The folder of a study: `study.json`, a run folder a session in `runs/`, `trials.jsonl` and `answers.jsonl`.

Both journals only grow, and each line is on the disk before anything else happens. A trial counts once its line says that it is
finished or abandoned; its answers are written before that line, with its attempt. So a kill at any moment costs at most the
trial that was running, which is begun again. A last line that was cut short is taken out, and kept beside the journal.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from cogrip.experiments.study.plan import Done, Trial
from cogrip.experiments.study.study_file import Study, StudyError
from cogrip.protocol.texts import named

STUDY, TRIALS, ANSWERS, RUNS = "study.json", "trials.jsonl", "answers.jsonl", "runs"
PARTIAL = f"{STUDY}.part"  # name of the study file while it is written; a kill may leave it
CUT = ".cut"  # ending of the file beside a journal that holds its lines which were cut short
_FILLING = b"\0\r\n"

Status = Literal["begun", "failed", "finished", "abandoned"]
Mode = Literal["simulated", "live"]
L = TypeVar("L", bound=msgspec.Struct)


class TrialLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line of trials.jsonl. runs: folders, one a session; ended: how each did; values: what each session sets."""

    status: Status
    group: int
    people: tuple[str, ...]
    number: int
    block: str
    place: int
    attempt: int
    condition: str
    repetition: int
    practice: bool = False
    runs: tuple[str, ...] = ()
    ended: tuple[str, ...] = ()
    values: tuple[dict[str, Any], ...] = ()
    track: str = ""
    level: float | None = None
    right: int | None = None
    correct: bool | None = None
    pauses: int = 0
    reason: str = ""
    utc: str = ""
    mode: Mode = "simulated"

    @property
    def over(self) -> bool:
        return self.status in ("finished", "abandoned")

    @property
    def done(self) -> Done:
        return Done(self.block, self.place, self.track, self.level, self.correct)


class AnswerLine(msgspec.Struct, frozen=True, omit_defaults=True):
    """A line of answers.jsonl. place, attempt: of the trial; place -1 for questions at the end of a block."""

    group: int
    participant: str
    block: str
    place: int
    attempt: int
    question: str
    answer: int | str
    utc: str = ""


class StudyFolder:
    """The folder of one study, new or to be resumed, until `close`.

    trials, answers  all lines so far
    mode             of all trials
    notes            what was mended as it was opened, a sentence each
    """

    def __init__(
        self, path: Path, study: Study, base: Mapping[str, Any], mode: Mode = "simulated",
        lock: Callable[[int], None] | None = None,
    ) -> None:  # fmt: skip
        """lock: raises OSError where another process has locked this file: each would run the other's trials again.

        Raises OSError, and StudyError for a folder of something else, in which nothing is changed, or one in use.
        """
        self.path, self.mode = path, mode
        query = {"study": msgspec.to_builtins(study), "settings": msgspec.to_builtins(base)}
        query = json.loads(json.dumps(query))
        if path.exists() and (not path.is_dir() or any(each.name != PARTIAL for each in path.iterdir())):
            found = self._checked(query)
            self._refuse_other_mode()
            if found != query:
                _write(path / STUDY, query)
        else:
            path.mkdir(parents=True, exist_ok=True)
            _write(path / STUDY, query)
        (path / RUNS).mkdir(exist_ok=True)
        with ExitStack() as files:
            if lock:
                try:
                    lock(files.enter_context((path / TRIALS).open("ab")).fileno())
                except OSError:
                    raise StudyError(
                        f"{path} is in use: another `cogrip study` runs its trials; wait until it has ended"
                    ) from None
                _sync(path)
            self.notes = [*_mend(path / TRIALS, TrialLine), *_mend(path / ANSWERS, AnswerLine)]
            self.trials, self.answers = read_trials(path), read_answers(path)
            self._files = files.pop_all()

    def close(self) -> None:
        """Let another process go on with the study."""
        self._files.close()

    def _checked(self, query: Mapping[str, Any]) -> dict[str, Any]:
        """Return what the folder holds. Raises StudyError for another study; participants may be added at the end."""
        found = _query(self.path)
        known = _whole(found.get("study", {}))
        before, now = known.get("participants", []), query["study"]["participants"]
        if now[: len(before)] == before:
            known["participants"] = now
        known = {**found, "study": known}
        if differ := [each for part in query for each in _different(known.get(part, {}), query[part], part)]:
            raise StudyError(
                f"{self.path} holds another study (other {named(sorted(differ))}); name another folder, or take the study "
                f"back to what it was ({self.path / STUDY})"
            )
        return found

    def _refuse_other_mode(self) -> None:
        """Raise StudyError for a folder with trials of the other mode: a rehearsal does not stand in for people."""
        if any(line.mode != self.mode for line in read_trials(self.path)):
            other = "live" if self.mode == "simulated" else "simulated"
            raise StudyError(
                f"{self.path} holds {other} trials, and these are {self.mode}; name another folder by --out"
            )

    def done(self, group: int) -> list[Done]:
        """Return the trials of a group that are over."""
        return [line.done for line in self.trials if line.group == group and line.over]

    def attempts(self, trial: Trial) -> int:
        """Return how often a trial was begun."""
        return max(
            (line.attempt for line in self.trials if line.group == trial.group and trial.same_as(line.done)), default=0
        )

    def answered(self, group: int, block: str, participant: str) -> set[str]:
        """Return the questions at the end of a block that a participant has answered."""
        return {
            line.question
            for line in self.answers
            if (line.group, line.block, line.place, line.participant) == (group, block, -1, participant)
        }

    def add_trial(self, line: TrialLine) -> None:
        """Keep a line of trials.jsonl, at once and on the disk."""
        _append(self.path / TRIALS, line)
        self.trials.append(line)

    def add_answer(self, line: AnswerLine) -> None:
        """Keep a line of answers.jsonl, at once and on the disk."""
        _append(self.path / ANSWERS, line)
        self.answers.append(line)


def _write(path: Path, query: Mapping[str, Any]) -> None:
    """Write the file as a whole or not at all."""
    partial = path.with_name(PARTIAL)
    partial.write_text(json.dumps(query, indent=2) + "\n", encoding="utf-8")
    partial.replace(path)


def open_study(path: Path) -> tuple[Study, dict[str, Any]]:
    """Return study and base settings of a folder. Raises StudyError."""
    query = _query(path)
    try:
        return msgspec.convert(query["study"], Study), query["settings"]
    except (KeyError, msgspec.ValidationError) as error:
        raise StudyError(f"{path / STUDY} does not say its study: {error}; name another folder") from None


def _query(path: Path) -> dict[str, Any]:
    try:
        found = json.loads((path / STUDY).read_text(encoding="utf-8"))
        if isinstance(found, dict):
            return found
    except (OSError, ValueError):
        pass
    raise StudyError(f"{path} is no study's folder ({STUDY} is missing or unreadable); name another")


def _different(before: Any, now: Any, key: str) -> Iterator[str]:
    """Yield the keys, with dots between them, whose values differ; list items by number."""
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        before, now = (dict(zip(map(str, range(len(each))), each, strict=True)) for each in (before, now))
    if isinstance(before, dict) and isinstance(now, dict):
        for each in {**before, **now}:
            yield from _different(before.get(each), now.get(each), f"{key}.{each}")
    elif before != now:
        yield key


def _whole(study: dict[str, Any]) -> dict[str, Any]:
    """Return a study with the keys that it left at their defaults; as it is where it is none.

    A staircase that says nothing of catch trials was written before there were any.
    """
    blocks = study.get("blocks")
    for block in blocks if isinstance(blocks, list) else ():
        if isinstance(block, dict) and isinstance(block.get("staircase"), dict):
            block["staircase"].setdefault("catch_every", 0)
    try:
        whole: dict[str, Any] = json.loads(msgspec.json.encode(msgspec.convert(study, Study)))
    except msgspec.ValidationError:
        return dict(study)
    return whole


def read_trials(path: Path) -> list[TrialLine]:
    """Return the whole lines of trials.jsonl. Raises StudyError for one that is none."""
    return _read(path / TRIALS, TrialLine)


def read_answers(path: Path) -> list[AnswerLine]:
    """Return the whole lines of answers.jsonl. Raises StudyError for one that is none."""
    return _read(path / ANSWERS, AnswerLine)


def _read(path: Path, kind: type[L]) -> list[L]:
    if not path.exists():
        return []
    found = []
    for number, line in enumerate(_whole_lines(path.read_bytes(), kind), 1):
        try:
            found.append(msgspec.json.decode(line, type=kind))
        except msgspec.MsgspecError as error:
            raise StudyError(
                f"{path}:{number}: is no line of a study: {error}; mend the line, or remove it: what it says is then done again"
            ) from None
    return found


def _whole_lines(content: bytes, kind: type[L]) -> list[bytes]:
    """Return the lines of a journal without a last one that was cut short, whether or not it has an end.

    A last line whose end alone is missing is whole. A loss of power may leave zeros behind it, an editor line ends.
    """
    content = content.rstrip(_FILLING)
    lines = content.split(b"\n") if content else []
    try:
        if lines:
            msgspec.json.decode(lines[-1], type=kind)
    except msgspec.MsgspecError as error:
        if "truncated" in str(error) or f"(byte {len(lines[-1])})" in str(
            error
        ):  # nothing is wrong but that it ends there
            lines.pop()
    return lines


def _mend(path: Path, kind: type[L]) -> list[str]:
    """Take out a last line that was cut short, as its writer was killed, and say so; end one that has no end."""
    if not path.exists():
        return []
    content = path.read_bytes()
    lines = _whole_lines(content, kind)
    whole = len(b"\n".join(lines))  # bytes of `content`
    end, rest = b"\n" if lines else b"", content[whole:].strip(_FILLING)
    if rest:
        with path.with_suffix(CUT).open("ab") as file:
            file.write(rest + b"\n")
            os.fsync(file.fileno())
    if content[whole:] != end:
        with path.open("r+b") as file:
            file.seek(whole)
            file.write(end)
            file.truncate()
            file.flush()
            os.fsync(file.fileno())
    said = f"{path}: its last line was cut short; it stands in {path.with_suffix(CUT).name}, and what it said is done again"
    return [said] if rest else []


def _append(path: Path, line: msgspec.Struct) -> None:
    new = not path.exists()
    with path.open("ab") as file:
        file.write(msgspec.json.encode(line) + b"\n")
        file.flush()
        os.fsync(file.fileno())
    if new:
        _sync(path.parent)


def _sync(folder: Path) -> None:
    """Have the entries of a folder on the disk, where a folder can be opened: on Windows it cannot."""
    try:
        entries = os.open(folder, os.O_RDONLY)
    except PermissionError:
        return
    try:
        os.fsync(entries)
    finally:
        os.close(entries)
