"""The kinds of folder in a list of runs, and the words for a comparison, which is no session of its own."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from cogrip.machine.addition import add_integers
from cogrip.protocol.recording.header import Header
from cogrip.results.reading.folder import SUMMARY
from cogrip.results.reading.summary_values import Summary, is_number, people
from cogrip.results.verdict.compared_methods import failed_methods, failed_of_ours, failure_sentence
from cogrip.results.verdict.judgement import Tone

Kind = Literal["session", "lab", "replay", "what-if", "comparison"]

_MANIFESTS = ("comparison.json", "sweep.json")  # manifests that `cogrip compare` and `cogrip sweep` write
_CELLS = "cells.jsonl"
_COMPARED = "comparison.html"
_REPLAY = "replay:"


class Word(NamedTuple):
    """One reason of a verdict, and the same in a word or two ("" where it is good)."""

    tone: Tone
    text: str
    brief: str = ""


def is_comparison(folder: Path) -> bool:
    """Return whether a comparison of methods, or a sweep, was begun here."""
    return any((folder / name).is_file() for name in _MANIFESTS)


def kind_of(folder: Path, headers: Sequence[Header], settings: dict[str, Any]) -> Kind:
    """Return what a run is: in another world, of recorded hands alone, in virtual time, or live."""
    places = (folder, folder.absolute().parent)
    if any("-what-if" in place.name and (place / _COMPARED).is_file() for place in places):
        return "what-if"
    clients = [header.start for header in headers if header.role == "client"]
    devices = [str(user.get("device", "")) for user in people(settings)] or [_device(start) for start in clients]
    if devices and all(device.startswith(_REPLAY) for device in devices):
        return "replay"
    return "lab" if any(header.virtual for header in headers) else "session"


def _device(start: str) -> str:
    """Return the device that a client's recording was begun with."""
    try:
        return str(json.loads(start)["hello"]["device"])
    except (ValueError, KeyError, TypeError):
        return ""


def comparison_words(folder: Path, summary: Summary) -> Iterator[Word]:
    """Yield how far it has come, and whether cogrip's own methods held in it."""
    done, total = summary.get("run"), summary.get("sessions")
    if done is None or total is None or not (is_number(done) and is_number(total)):
        cells = _lines(folder / _CELLS)
        if (folder / _MANIFESTS[1]).is_file():
            yield Word("good", f"a sweep, {cells} cases", f"{cells} cases")
        elif not (folder / SUMMARY).exists():
            yield Word("warn", f"a comparison that was cut short after {cells} sessions", f"{cells} sessions")
        else:
            yield Word("bad", f"{SUMMARY} holds no comparison", "unreadable")
        return
    if done < total:
        yield Word("warn", f"{done} of {total} sessions were run", f"{done}/{total} run")
    try:
        failed, not_run = failed_of_ours(summary), add_integers(row["failed"] for row in summary["rows"])
    except (KeyError, TypeError):
        text = f"{SUMMARY} holds no comparison that can be judged; `cogrip compare` with --out writes it again"
        yield Word("bad", text, "unreadable")
        return
    if not_run:
        yield Word("warn", f"{not_run} sessions could not be run", f"{not_run} not run")
    if failed:
        yield Word("bad", failure_sentence(failed), f"{failed_methods(failed)} failed")
    yield Word("good", f"{done} sessions compared", f"{done} sessions")


def _lines(path: Path) -> int:
    try:
        with path.open("rb") as file:
            return add_integers(1 for _ in file)
    except OSError:
        return 0
