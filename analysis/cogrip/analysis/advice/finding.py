"""One sentence of advice with its level, and the rows that people with the same one share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import expm1, log
from typing import Literal

from cogrip.machine.addition import add_integers

Level = Literal["ok", "note", "warning"]
LEVELS: tuple[Level, ...] = ("ok", "note", "warning")


@dataclass(frozen=True, slots=True)
class Finding:
    """One sentence. "warning": the session lies outside; "note": worth knowing. refused: nobody should hold a device in it."""

    topic: str
    text: str
    level: Level = "ok"
    refused: bool = False

    @property
    def warns(self) -> bool:
        return self.level == "warning"


def said_of(finding: Finding, people: Iterable[str]) -> str:
    """Return the person of whom a finding is, "" where it is of all."""
    name, _, _ = finding.text.partition(": ")
    return name if name in people else ""


def in_rows(findings: Iterable[Finding], people: Sequence[str]) -> dict[tuple[Level, str, str], list[str]]:
    """Return the people of each row, by level, topic and words: those with the same finding share one."""
    rows: dict[tuple[Level, str, str], list[str]] = {}
    for finding in findings:
        whose = said_of(finding, people)
        text = finding.text.removeprefix(f"{whose}: ") if whose else finding.text
        rows.setdefault((finding.level, finding.topic, text), []).append(whose)
    return rows


def warning_rows(findings: Iterable[Finding], people: Sequence[str]) -> int:
    """Return how many warnings are printed."""
    return add_integers(level == "warning" for level, _, _ in in_rows(findings, people))


def plain(value: float, digits: int = 4) -> str:
    """Return a number rounded to so many digits, written without an exponent below a million."""
    return f"{float(f'{value:.{digits}g}'):g}"


def growth(radius: float, frame_s: float) -> str:
    """Return in words how fast a motion grows whose amplitude is `radius` times as large after each frame; radius > 1."""
    rate = log(radius) / frame_s  # 1/s
    if rate < log(2.0):
        return f"growth of {plain(100.0 * expm1(rate), 2)} % per second"
    double_s = log(2.0) / rate
    return f"growth, twofold every {plain(1e3 * double_s, 2)} ms,"
