"""The runs in a folder, newest first, each with its verdict in a line. Of recordings only their heads are read."""

import json
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cogrip.machine.addition import add_integers
from cogrip.protocol.recording.folder import RECOVERED, recordings_of, seats_of
from cogrip.protocol.recording.reader import Recording, RecordingError, open_recording
from cogrip.protocol.recording.recover import is_closed
from cogrip.protocol.texts import all_shown, shown
from cogrip.results.listing.kind import Kind, Word, comparison_words, is_comparison, kind_of
from cogrip.results.reading.folder import SETTINGS, SUMMARY, client_recording
from cogrip.results.reading.summary_values import Summary, dig, is_number, name_of, people, task_of, task_result
from cogrip.results.verdict.felt_as_intended import SOFTER_BRIEF
from cogrip.results.verdict.incidents import ended_saturated, is_unstable, word_of
from cogrip.results.verdict.judgement import Judgement, Tone
from cogrip.results.verdict.verdict import came, judgements, stable, unjudged
from cogrip.results.verdict.verdict_text import notes

_TIME = re.compile(r"\d{8}-\d{6}(?=-|$)")
_TONES: tuple[Tone, ...] = ("good", "warn", "bad")
_LOST = ("not recorded", "recording stopped")  # names under which a run counts what its recording lacks


@dataclass(frozen=True, slots=True)
class ListedRun:
    """name: of its folder below the one that was listed. tone: `good`, `warn` or `bad`, as in a report.

    verdict has every reason, brief the worst of them in a word or two.
    """

    name: str
    folder: Path
    kind: Kind
    when: datetime
    seconds: float | None
    people: tuple[str, ...]
    tone: Tone
    brief: str
    verdict: str
    size_bytes: int


def list_runs(base: Path, is_running: Callable[[Path], bool]) -> list[ListedRun]:
    """Return the runs right below `base`, the rooms of a run of several, or `base` itself if it is a run. Raises OSError.

    is_running: True for a recording that is not closed and still being written.
    """
    below = list(_below(base)) or ([base] if _is_run(base) else [])
    listed = [_listed(folder, base, is_running) for folder in below]
    return sorted(listed, key=lambda run: (run.when, run.name), reverse=True)


def _below(base: Path) -> Iterator[Path]:
    for folder in sorted(base.iterdir()):
        if folder.is_dir() and not folder.name.startswith("."):
            try:
                rooms = [room for room in sorted(folder.iterdir()) if room.is_dir() and _is_run(room)]
                # of a server of several rooms the folder itself holds only the recording; a what-if is a run beside another
                mine = _is_run(folder) and (not rooms or (folder / SETTINGS).is_file() or is_comparison(folder))
            except OSError:  # whose else it is
                continue
            if mine:
                yield folder
            yield from rooms


def _is_run(folder: Path) -> bool:
    """Return True for the folder of a run; settings alone are one only where the folder or its parent is named like one."""
    if (folder / SUMMARY).is_file() or is_comparison(folder) or any(folder.glob("*.mcap")):
        return True
    named = _TIME.match(folder.name) or _TIME.match(folder.absolute().parent.name)
    return bool(named) and (folder / SETTINGS).is_file()


def _listed(folder: Path, base: Path, is_running: Callable[[Path], bool]) -> ListedRun:
    words: list[Word] = []
    summary = _table(folder / SUMMARY, words)
    if is_comparison(folder):
        return _comparison(folder, base, summary, words)
    settings = _table(folder / SETTINGS, words)
    files = recordings_of(folder)
    recordings = _open(files, words)
    names = [name_of(user) for user in people(summary) or people(settings)] or _seats(recordings, words)
    unclosed = [recording.path for recording in recordings if not is_closed(recording.path)]
    running = any(map(is_running, unclosed))
    if summary:
        words += _of_summary(summary)
    elif running:
        words.append(Word("warn", "it still runs", "running"))
    elif not (folder / SUMMARY).exists():
        words.append(Word("bad", f"cut short: no {SUMMARY}", "cut short"))
    words += _of_recordings(files, names, bool(settings))
    words += [Word("warn", f"{file.name} was not closed", "not closed") for file in unclosed if not running]
    kind = kind_of(folder, [recording.header for recording in recordings], settings)
    return _made(folder, base, kind, summary, names, words, _size(folder, files))


def _comparison(folder: Path, base: Path, summary: Summary, words: list[Word]) -> ListedRun:
    """Return the row of a comparison of methods, or a sweep: no session, so nothing of it is passive or stable."""
    words += comparison_words(folder, summary)
    asked = dig(summary, "asked", "settings")
    names = [name_of(user) for user in people(asked if isinstance(asked, dict) else {})]
    seconds = {"seconds": dig(asked, "seconds")}
    return _made(folder, base, "comparison", seconds, names, words, _size(folder, ()))


def _made(
    folder: Path, base: Path, kind: Kind, summary: Summary, names: Iterable[str], words: list[Word], size_bytes: int
) -> ListedRun:
    words = sorted(words, key=lambda each: -_TONES.index(each.tone))
    worst, seconds = words[0], summary.get("seconds")
    return ListedRun(
        folder.relative_to(base).as_posix() if folder != base else folder.resolve().name,
        folder,
        kind,
        _when(folder),
        float(seconds) if seconds is not None and is_number(seconds) else None,
        tuple(names),
        worst.tone,
        worst.brief or "good",
        shown("; ".join(word.text for word in words)),
        size_bytes,
    )


def _table(path: Path, words: list[Word]) -> dict[str, Any]:
    """Return a JSON table; an empty one where there is none, and what is wrong with it into `words`."""
    try:
        table = all_shown(json.loads(path.read_bytes()))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:
        text = f"{path.name} is not readable ({getattr(error, 'strerror', None) or error})"
        words.append(Word("bad", text, "unreadable"))
        return {}
    if isinstance(table, dict) and table:
        return table
    words.append(Word("bad", f"{path.name} holds no table", "unreadable"))
    return {}


def _open(files: Iterable[Path], words: list[Word]) -> list[Recording]:
    """Return the recordings that have a header; the others go into `words`."""
    found = []
    for file in files:
        try:
            found.append(open_recording(file))
        except RecordingError as error:
            words.append(Word("bad", str(error).partition(";")[0].replace(str(file), file.name), "damaged file"))
        except OSError as error:
            words.append(Word("bad", f"{file.name}: {error.strerror}", "unreadable"))
    return found


def _seats(recordings: list[Recording], words: list[Word]) -> list[str]:
    try:
        return seats_of(recordings)
    except (KeyError, TypeError, ValueError) as error:
        words.append(Word("bad", f"a recording's start is not readable ({error!r})", "damaged file"))
        return []


def _of_summary(summary: Summary) -> Iterator[Word]:
    """Return what a report says, but in a line: of a session that was unstable nothing else."""
    broken = stable(summary).tone == "bad"
    found: tuple[Judgement, ...] = judgements(summary)
    if unjudged(summary) and came(summary) and "bad" not in (judgement.tone for judgement in found):
        text = "not known whether passive, stable and felt as intended: nothing was reported of device ports"
        yield Word("warn", text, "not known")
        found = ()
    for judgement in found:
        if judgement.tone != "good" and not (broken and judgement.name == "felt as intended"):
            text = judgement.brief or _as_part(judgement.sentence)
            yield Word(judgement.tone, text, _short(judgement, summary) if came(summary) else "nobody came")
    if good := [judgement.name for judgement in found if judgement.tone == "good"]:
        yield Word("good", ", ".join(good))
    for tone, sentence, about in () if broken else notes(summary):
        if tone != "good":
            saturated = about == "ended badly" and ended_saturated(summary)
            yield Word(tone, _as_part(sentence), word_of(summary) if saturated else about)
    task = task_of(summary)
    if task is not None and task.get("reached") is not True and not broken:
        yield Word("warn", f"task {task_result(task)}", "task not reached")
    for name in _LOST:
        if count := dig(summary, "server", "dropped", name):
            yield Word("warn", f"{count} messages not recorded" if name == _LOST[0] else name, "not recorded")


def _short(judgement: Judgement, summary: Summary) -> str:
    """Return the word for a judgement that is not good."""
    if judgement.name == "felt as intended":
        if judgement.brief == SOFTER_BRIEF:
            return SOFTER_BRIEF
        return "not as intended" if judgement.brief else "not known"
    if judgement.tone == "warn":
        return (judgement.name == "stable" and word_of(summary)) or "not known"
    if judgement.name == "passive":
        return "not passive"
    return "unstable" if is_unstable(summary) else "oscillates"


def _as_part(sentence: str) -> str:
    """Return a sentence as a part of another."""
    return f"{sentence[0].lower()}{sentence[1:].rstrip('.')}" if sentence[1:2].islower() else sentence


def _of_recordings(files: list[Path], names: list[str], whole: bool) -> Iterator[Word]:
    """Yield what is not recorded here; whole: the server's should be. Clients on other machines keep their own."""
    if not files:
        yield Word("warn", "no recording is here", "no recording")
        return
    there = {file.name.removesuffix(RECOVERED).removesuffix(".mcap") for file in files}
    missing = [name for name in names if client_recording(name).removesuffix(".mcap") not in there]
    if whole and not any(file.startswith("server") for file in there):
        missing.append("the server")
    if missing:
        yield Word("good", f"not recorded here: {', '.join(missing)}")


def _when(folder: Path) -> datetime:
    """Return the local time in the name of the folder, or of the run whose room it is; else when it was last changed."""
    for name in (folder.name, folder.absolute().parent.name):
        if found := _TIME.match(name):
            try:
                return datetime.strptime(found[0], "%Y%m%d-%H%M%S").astimezone()
            except ValueError:
                continue
    return datetime.fromtimestamp(folder.stat().st_mtime, UTC).astimezone()


def _size(folder: Path, files: Iterable[Path]) -> int:
    """Return the size of all that is in the folder, and of recordings elsewhere that are its too."""
    everything = {*(path for path in folder.rglob("*") if path.is_file()), *files}
    return add_integers(path.stat().st_size for path in {path.resolve() for path in everything})
