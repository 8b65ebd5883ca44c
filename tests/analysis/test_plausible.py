"""Tests of implausible inputs, on both sides of each bound."""

from math import pi, sin
from pathlib import Path
from typing import Any

import pytest

from cogrip.analysis.advice.finding import Finding
from cogrip.analysis.advice.plausible import implausible
from cogrip.protocol.settings.room import resolve


def found(hand: str = "hold", device: str = "sim:phantom", **tables: Any) -> list[Finding]:
    return implausible(resolve({"seconds": 4.0, "users": [{"name": "anna", "hand": hand, "device": device}], **tables}))


@pytest.mark.parametrize(
    ("hand", "warns", "refused"),
    [
        ("reach&amplitude_m=0.127", "", False),
        ("reach&amplitude_m=0.128", "beyond the -0.127 to 0.127 m of device sim:phantom", False),
        ("reach&amplitude_m=0.253", "beyond", False),
        ("reach&amplitude_m=0.255", "beyond", True),
        ("reach&amplitude_m=-0.255", "to go to -0.255 m along x", True),
        ("sine&offset_m=0.2", "to go to 0.205 m", False),
        ("reach&amplitude_m=30&stroke_s=100", "", False),
        ("reach&amplitude_m=30&stroke_s=3.9", "to move by 30 m along x; an arm reaches 1 m", True),
        ("reach&amplitude_m=0.1&stroke_s=0.1", "", False),
        ("reach&amplitude_m=0.1&stroke_s=0.09", "faults above 2 m/s", False),
        ("reach&amplitude_m=0.1&stroke_s=0.06", "at 3.1", False),
        ("reach&amplitude_m=0.1&stroke_s=0.018", "at 10.", True),
        ("push&force_n=8.5", "", False),
        ("push&force_n=9", "pushes with 9 N, more than the 8.5 N", False),
    ],
)
def test_motion_that_a_device_or_a_hand_cannot_make(hand: str, warns: str, refused: bool) -> None:
    findings = [] if "stroke_s=100" in hand else found(hand)
    assert bool(findings) == bool(warns)
    if warns:
        assert any(warns in finding.text for finding in findings)
        assert any(finding.refused for finding in findings) == refused


@pytest.mark.parametrize("device", ["sim:phantom", "sim:ideal", "emulated:vintage", "replay"])
def test_millimetres_read_as_metres_are_refused_with_their_scale(tmp_path: Path, device: str) -> None:
    """The motion is that of a simulated hand or of a replay."""
    file = tmp_path / "hand.csv"
    file.write_text("t_s,x\n" + "".join(f"{0.01 * k},{30.0 * sin(pi * 0.01 * k)}\n" for k in range(400)))
    where = f"{file}{{}}time=t_s&x=x"

    def read(scale: str) -> list[Finding]:
        if device == "replay":
            return found("hold", f"replay:{where.format('#')}{scale}")
        return found(f"csv:{where.format('&')}{scale}", device)

    [first, *_] = read("")
    assert first.refused
    assert "scale=0.001 reads millimetres" in first.text
    assert read("&scale=0.001") == []


@pytest.mark.parametrize(("mass_kg", "warns", "refused"), [(20.0, 0, 0), (20.1, 1, 0), (100.0, 1, 0), (200.0, 1, 1)])
def test_masses_that_no_hand_moves(mass_kg: float, warns: int, refused: int) -> None:
    for findings in (
        found(object={"mass_kg": mass_kg}),
        implausible(resolve({"seconds": 1.0, "users": [{"name": "anna", "hand": "hold", "device_mass_kg": mass_kg}]})),
    ):
        assert [finding.level for finding in findings] == ["warning"] * warns
        assert sum(finding.refused for finding in findings) == refused
    assert found(object={"kind": "wall", "mass_kg": mass_kg}) == [], "a wall does not move"
