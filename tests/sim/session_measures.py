"""Runs and measures of whole sessions in virtual time, shared by tests."""

from typing import Any

from cogrip.protocol.settings import Playout, resolve
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
    """Return by how much the least passivity margin of anybody's line is above what the default credit allows [J]."""
    return float(min(user["energy"][key] + allowed(key) for user in summary["users"] for key in MARGINS))


def allowed(key: str) -> float:
    """Return by how much this margin may be below 0 with the default credit, of which a whole line has two [J]."""
    return 1e-3 * Playout().tank_mj * (2.0 if key == "line_margin_j" else 1.0)
