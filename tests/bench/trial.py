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
Case = tuple[str, str, str, int]
"""arm, hand, fault, ticks by which samples are late"""


def judged(outcome: Tried, words: str) -> str:
    """Return what became of a case. words: of the fault that is there, "" where none is."""
    if outcome.faults:
        right = words and all(words in text for text in outcome.faults)
        return "named" if right else "named with others" if words and words in outcome.text else "another named"
    return "not determined" if outcome.unknown else "said to be well"


def counted(cases: Iterable[Case], words: str) -> str:
    """Return how often each came of these cases, in words."""
    found: Counter[str] = Counter()
    for arm, hand, fault, late_ticks in cases:
        with suppress(DeviceError):  # the hand left the arm's workspace
            found[judged(tried(arm, hand, fault, late_ticks), words)] += 1
    return ", ".join(f"{what} {count}" for what, count in found.most_common())


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
        told = [
            counted([(arm, hand, fault, late_ticks) for arm in arms for hand in held_by], words)
            for arms in (fine, COARSE)
        ]
        refused = refused or (not words and any("another" in text for text in told))
        rows.append((what, *told))

    for fault in FAULTS:
        row(fault, WORDS[fault], fault=fault)
    for late_ticks in range(1, 9):
        row(f"{late_ticks} ticks late", LATE, late_ticks=late_ticks)
    row("well", "")
    row("well, held like a rock", "", held_by=[RIGID])
    row("well, in a hand that moves", "", held_by=MOVING[:3])
    with tempfile.TemporaryDirectory() as folder:
        row("well, in recorded hands", "", held_by=list(pieces(Path(folder), 0, recorded)))
    make_console(soft_wrap=True).print(plain_table(("device", "five arms", "2diy"), rows))
    return int(refused)
