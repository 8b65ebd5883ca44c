"""Codes of a study's events on a trigger line, 1 to 255, by `[triggers]` of its file.

begin, end               of each session; `end time`, `end goal` and `end operator` by how it ended
phase NAME               beginning of this phase
marker TEXT, marker      marker of these words, and every other one
"""

from collections.abc import Collection, Mapping
from typing import get_args

from cogrip.experiments.study.phases import phase_begun
from cogrip.experiments.study.trial import How, begun_by, ended_by

ANY = "*"
"""Marker that stands for all that have no code of their own, as `cogrip serve --trigger-code` has it."""
_PHASE, _MARKER, _END = "phase ", "marker ", "end "


def unfit_triggers(triggers: Collection[str], phases: Collection[str]) -> str:
    """Return which event of `[triggers]` no study with these phases has, and the cure; "" where all are known."""
    known = {
        "begin",
        "end",
        "marker",
        *(f"{_END}{how}" for how in get_args(How)),
        *(f"{_PHASE}{name}" for name in phases),
    }
    wrong = next((each for each in triggers if each not in known and not each.startswith(_MARKER)), None)
    return (
        "" if wrong is None else f"{wrong}: there is no such event; there is: {', '.join(sorted(known))}, marker TEXT"
    )


def codes_of_run(triggers: Mapping[str, int], run: str) -> dict[str, int]:
    """Return the codes of a session's markers by their words. run: name of its run folder."""
    found: dict[str, int] = {}
    for event, code in triggers.items():
        if event == "begin":
            found[begun_by(run)] = code
        elif event == "end":
            for how in get_args(How):
                found.setdefault(ended_by(run, how), code)
        elif event.startswith(_END):
            found[ended_by(run, event.removeprefix(_END))] = code
        elif event.startswith(_PHASE):
            found[phase_begun(run, event.removeprefix(_PHASE))] = code
        else:
            found[event.removeprefix(_MARKER) if event.startswith(_MARKER) else ANY] = code
    return found


def words_of(marker: str, names: Collection[str]) -> str:
    """Return the words of a marker, without the name of the person who set it."""
    own = next((f"{name} " for name in names if marker.startswith(f"{name} ")), "")
    return marker.removeprefix(own)


def code_of(codes: Mapping[str, int], words: str) -> int | None:
    """Return the code of a marker with these words; None where it has none."""
    return codes.get(words, codes.get(ANY))
