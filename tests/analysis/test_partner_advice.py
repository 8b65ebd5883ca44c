"""Advice on rooms of partners' models."""

from typing import Any

import pytest

from cogrip.analysis.advice.finding import plain
from cogrip.analysis.advice.partner_advice import partner_findings, partner_loop
from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings


def room(people: int, delay_ms: float = 0.0, **coupling: Any) -> Settings:
    users = [{"name": f"p{each}", "device": "sim:ideal?mass_kg=0.1&damping_nspm=0.5"} for each in range(people)]
    return resolve({
        "coupling": {"kind": "partner", "stiffness_npm": 1000.0, "damping_nspm": 10.0, **coupling},
        "object": {"axes": 1, "mass_kg": 0.2}, "link": {"delay_ms": delay_ms}, "users": users,
    })  # fmt: skip


def texts(settings: Settings, topic: str) -> list[str]:
    return [finding.text for finding in partner_findings(settings) if finding.topic == topic]


@pytest.mark.parametrize("people", [2, 5])
def test_it_tells_the_loop_gain_and_the_stiffness_at_rest(people: int) -> None:
    settings = room(people)
    loop = partner_loop(settings)
    (text,) = texts(settings, "stability")
    assert f"loop gain of {people} hands" in text
    assert f"{loop.worst(300.0):.2f} (300)" in text
    assert texts(settings, "feel") == [
        f"against partners at rest of 300 N/m: {plain(loop.felt_npm(300.0))} N/m at any delay"
    ]


def test_a_long_delay_is_noted_and_one_person_has_nobody_to_model() -> None:
    assert "100 ms each way" in texts(room(2, 100.0), "feel")[1]
    assert len(texts(room(2, 99.0), "feel")) == 1
    assert texts(room(1), "stability") == ["one person alone: there is nobody to model"]


def test_a_damper_that_no_device_carries_is_refused() -> None:
    refused = [finding for finding in partner_findings(room(2, damping_nspm=60.0)) if finding.refused]
    assert len(refused) == 2
    assert "coupling.damping_nspm" in refused[0].text


def test_of_copies_of_a_scene_no_loop_gain_is_told() -> None:
    settings = load(shipped("lift"), ["coupling.kind=partner"])
    (text,) = texts(settings, "stability")
    assert "no linear model" in text
    assert "gain" not in text
    assert not texts(settings, "feel")
