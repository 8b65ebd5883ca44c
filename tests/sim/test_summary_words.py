"""What is said of a summary: the verdict in sentences, the table in the terminal, numbers with units."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from cogrip.sim.verdict import energy, number, share, verdict

from tests.sim.reported_runs import printed


def words(summary: dict[str, Any]) -> str:
    return " ".join(sentence for _, sentence in verdict(summary))


@pytest.mark.parametrize("summary", [{}, {"users": None}, {"users": [None, 3, {}]}, {"server": 7, "object": []}])
def test_strange_summaries_print(summary: dict[str, Any]) -> None:
    assert printed(summary)


def test_verdict_names_who_broke_passivity_and_by_how_much(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Passive" in words(summary)
    assert "Nothing diverged" in words(summary)
    summary["passive"] = False
    summary["users"][1]["energy"]["down_margin_j"] = -0.0034
    assert "Not passive: the line down of ben gave out 3.4 mJ more than had been put in." in words(summary)


def test_verdict_says_why_it_diverged(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    summary["diverged"] = True
    assert "The object left the workspace" in words(summary)
    summary["users"][0]["reason"] = "force at its limit"
    assert "Diverged. anna: force at its limit." in words(summary)


def test_verdict_counts_ticks(finished: Path) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    assert "Every loop ran every tick." in words(summary)
    summary["users"][0]["ticks"] = {"due": 1000, "run": 990, "late_us": {"p99": 312.4}}
    assert "anna 99.00 %" in words(summary)
    assert "within 312 µs" in words(summary)


@pytest.mark.parametrize("width", [80, 100])
def test_terminal_table_fits(finished: Path, width: int) -> None:
    summary = json.loads((finished / "summary.json").read_text())
    for user in summary["users"]:
        user["position_m"] = [0.0123, -0.0123, 0.0]
        user["ticks"]["late_us"]["p99"] = 1234.5
    lines = printed(summary, width).splitlines()
    assert max(map(len, lines)) <= width
    if width == 100:
        table = "\n".join(lines[: 4 + len(summary["users"])])
        assert "…" not in table
        assert "12.3 −12.3 0.0" in table


@pytest.mark.parametrize(
    ("value_j", "text"),
    [
        (None, "not known"),
        (math.nan, "nan"),
        (0.0, "0 J"),
        (-3e-22, "0 J"),
        (-0.0034, "−3.4 mJ"),
        (12.0, "12 J"),
        (2.5e-8, "25 nJ"),
    ],
)
def test_energy_takes_the_unit_that_fits(value_j: float | None, text: str) -> None:
    assert energy(value_j) == text


def test_numbers_do_not_lie_by_rounding() -> None:
    assert share(0.999999) == "99.99 %"
    assert share(1.0) == "100 %"
    assert number(-0.0001) == "0.0"
    assert number(True) == "True"
