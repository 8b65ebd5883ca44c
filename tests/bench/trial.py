"""`dev.py bench trial`: what the trial of motors before a seat names, on emulated arms in simulated and recorded hands."""

import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import plain_table
from cogrip.devices.device import DeviceError
from cogrip.devices.motor_trial import Tried

from tests.devices.faulty_device import FAULTS
from tests.devices.test_motor_trial import ARMS, COARSE, DATA, FIRM, MOVING, RIGID, SOFT, WORDS, pieces, tried

LATE = "ticks later than they say"
OUTCOMES = NAMED, BESIDE, OTHER, UNKNOWN, WELL = "named", "beside", "other", "unknown", "well"
Case = tuple[str, str, str, int]
"""arm, hand, fault, ticks by which samples are late"""


def judged(outcome: Tried, words: str) -> str:
    """Return what became of a case. words: of the fault that is there, "" where none is."""
    if outcome.faults:
        right = words and all(words in text for text in outcome.faults)
        return NAMED if right else BESIDE if words and words in outcome.text else OTHER
    return UNKNOWN if outcome.unknown else WELL


def counted(cases: Iterable[Case], words: str) -> Counter[str]:
    """Return how often each came of these cases."""
    found: Counter[str] = Counter()
    for arm, hand, fault, late_ticks in cases:
        with suppress(DeviceError):  # the hand left the arm's workspace
            found[judged(tried(arm, hand, fault, late_ticks), words)] += 1
    return found


def bench_trial(*, recorded: int = 32) -> int:
    """Try the motors of emulated arms with each fault, held by 60 N/m and by 300 N/m, and of ones that are well.

    Exit code 1 where one that is well is refused.

    Parameters
    ----------
    recorded
        Pieces of recorded hands, of ../shared/data.
    """
    if recorded and not DATA.is_dir():
        raise Problem(f"{DATA} is not there, and holds the recorded hands; put it there, or give --recorded 0")
    fine, hands = [arm for arm in ARMS if arm not in COARSE], (SOFT, FIRM)
    rows: list[tuple[str, ...]] = []
    refused = False

    def row(what: str, words: str, *, fault: str = "", late_ticks: int = 0, held_by: Sequence[str] = hands) -> None:
        nonlocal refused
        for who, arms in (("five", fine), ("2diy", COARSE)):
            told = counted([(arm, hand, fault, late_ticks) for arm in arms for hand in held_by], words)
            refused = refused or (not words and told[OTHER] > 0)
            rows.append((what, who, *[str(told[each]) for each in OUTCOMES], str(told.total())))

    for fault in FAULTS:
        row(fault, WORDS[fault], fault=fault)
    for late_ticks in range(1, 9):
        row(f"{late_ticks} ticks late", LATE, late_ticks=late_ticks)
    row("well", "")
    row("well, in a rock", "", held_by=[RIGID])
    row("well, moving hands", "", held_by=MOVING[:3])
    with tempfile.TemporaryDirectory() as folder:
        row("well, recorded", "", held_by=list(pieces(Path(folder), 0, recorded)))
    make_console(soft_wrap=True).print(plain_table(("device", "arms", *OUTCOMES, "of"), rows, left=2))
    return int(refused)
