"""Runs and measures of whole sessions in virtual time, shared by tests."""

from typing import Any

from cogrip.protocol.settings import resolve
from cogrip.sim.runs.summary import of_laboratory
from cogrip.sim.session.laboratory import Laboratory

FRAME_MS = 1000.0 / 128  # 8 device ticks
MARGINS = ("up_margin_j", "down_margin_j", "line_margin_j")

Table = dict[str, Any]


def summary_of(bare: bool = False, **tables: object) -> Table:
    """Run a session of these settings to its end, and return its summary."""
    laboratory = Laboratory(resolve(tables), bare=bare)
    laboratory.run()
    return of_laboratory(laboratory)


def run_frames(laboratory: Laboratory, count: int) -> None:
    """Run so many network frames."""
    for _ in range(count):
        laboratory.frame()


def least_margin(summary: Table) -> float:
    """Return the least passivity margin of anybody's line [J]."""
    return float(min(user["energy"][key] for user in summary["users"] for key in MARGINS))
