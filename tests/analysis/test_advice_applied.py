"""Every piece of advice in random situations, applied and measured again: what is judged gets no worse, and costs are said."""

from __future__ import annotations

from collections.abc import Iterator
from math import exp, log
from random import Random
from typing import Any

import pytest
from msgspec import to_builtins
from msgspec.structs import replace

from cogrip.analysis.advice import laboratory_check
from cogrip.analysis.advice.advice import Advice, advise
from cogrip.analysis.advice.finding import LEVELS, Finding
from cogrip.analysis.advice.laboratory_check import MORE_CONTROLLED, check, checked_change
from cogrip.analysis.feel import felt_probe as felt
from cogrip.analysis.feel.felt_probe import measure_felt
from cogrip.analysis.linear.linear_session import ModelError
from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.safety.rendered_damper import rounded_down
from cogrip.devices.for_user import make_for
from cogrip.protocol.settings.room import rates_of, resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError
from cogrip.results.verdict.judgement import Tone
from cogrip.results.verdict.verdict import passive, stable
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

SITUATIONS = 40
DEVICES = (
    "sim:phantom", "sim:phantom?mass_kg=0.075", "sim:ideal", "sim:phantom?friction_n=0&resolution_m=0", "emulated:vintage",
    "emulated:aluhaptics", "emulated:2diy",
)  # fmt: skip
HANDS = ("reach&amplitude_m=0.02", "hold", "push&force_n=1.5&start_s=0.5", "sine&amplitude_m=0.01&frequency_hz=1.5")
FREE_HAND = "reach&amplitude_m=-0.015&stroke_s=0.5"  # away from what is pushed from the left
TONES: tuple[Tone, ...] = ("good", "warn", "bad")
TOLD = 1.05  # factor of a loss, from which on it has to be named


@pytest.fixture(scope="module", autouse=True)
def _brief() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laboratory_check, "MOST_SEEDS", 1)
        patch.setattr(laboratory_check, "SESSION_S", 2.5)
        patch.setattr(felt, "SETTLE_S", 0.8)
        patch.setattr(felt, "LAST_S", 0.6)
        yield


def situation(number: int) -> Settings:
    """Return settings as people may have them: within what the devices carry, and now and then beyond it."""
    chance = Random(f"advice {number}")
    object_kind = chance.choice(("wall", "wall", "cube", "faces"))
    kind = chance.choice(("wave", "wave", "wave", "coupling", "local" if object_kind != "cube" else "wave"))
    users = [
        {"name": name, "device": chance.choice(DEVICES), "hand": chance.choice(HANDS), "side": side}
        for name, side in (("anna", "left"), ("ben", "right"))[: chance.choice((1, 2))]
    ]
    overrides: dict[str, Any] = {
        "seconds": 2.5, "seed": number, "object.kind": object_kind, "coupling.kind": kind,
        "link.delay_ms": round(chance.choice((0.0, 2.0, 5.0)) + 200.0 * chance.random() ** 3, 1),
        "coupling.stiffness_npm": rounded_down(exp(chance.uniform(log(40.0), log(3000.0)))),
    }  # fmt: skip
    if kind == "coupling" and object_kind == "faces":
        overrides["coupling.kind"] = "wave"
    if chance.random() < 0.3:
        overrides |= {"link.jitter_ms": round(3.0 * chance.random(), 1), "link.loss": round(0.03 * chance.random(), 3)}
    settings = resolve({"users": users}, overrides)
    carried = min(
        largest_impedance(make_for(user, 1).capability, rates_of(settings, user).tick_s).impedance_nspm
        for user in settings.users
    )
    damper = rounded_down(carried * chance.choice((0.2, 0.5, 0.8, 1.0, 1.0, 1.3)))
    for key in ("coupling.impedance_nspm", "coupling.damping_nspm"):
        overrides[key] = damper
    return resolve({"users": users}, overrides)


class Measured:
    """Sessions of some settings beside those that advice was made with: their hands, free hands, and a static load."""

    def __init__(self, settings: Settings) -> None:
        free = replace(settings, users=tuple(replace(user, hand=FREE_HAND) for user in settings.users))
        self.tones: list[tuple[Tone, Tone]] = []
        self.controlled: list[float] = []
        self.let_go: list[int] = []
        for each in (replace(settings, seed=settings.seed + 1000), free):
            laboratory = Laboratory(each)
            laboratory.run()
            summary = of_laboratory(laboratory)
            self.tones.append((passive(summary).tone, stable(summary).tone))
            self.controlled.append(max(user["controlled"] for user in summary["users"]))
            self.let_go.append(sum(user["let_go"] for user in summary["users"]))
        self.felt = {each.person: each.felt_npm for each in measure_felt(replace(settings, seed=settings.seed + 1000))}

    @property
    def sound(self) -> bool:
        return all(tone != "bad" for pair in self.tones for tone in pair)


def missed(measured: Measured, asked: dict[str, float]) -> float:
    """Return the largest |felt / asked - 1|, 1 where nothing came to rest."""
    shares = [abs(npm / asked[name] - 1.0) if npm else 1.0 for name, npm in measured.felt.items()]
    return max(shares, default=0.0)


def level_of(advice: Advice, topic: str) -> int:
    found: list[Finding] = [finding for finding in advice.findings if finding.topic == topic]
    return max((LEVELS.index(finding.level) for finding in found), default=0)


@pytest.mark.sample(1)
@pytest.mark.parametrize("number", range(SITUATIONS))
def test_no_advice_makes_a_judged_case_worse(number: int) -> None:
    settings = situation(number)
    now = advise(settings)
    change = checked_change(settings, now, check(settings))
    if change is None:
        return
    there = resolve(to_builtins(settings), change.overrides)
    then = advise(there)
    before, after = Measured(settings), Measured(there)
    lost = bool(now.refusals) or not now.verdict.stable or not before.sound
    assert after.sound or not before.sound, change.setting
    assert then.refusals == ()
    for old, new in zip(before.tones, after.tones, strict=True):
        assert [TONES.index(tone) for tone in new] <= [max(TONES.index(tone), 0 if not lost else 1) for tone in old]
    assert (
        all(new <= old + MORE_CONTROLLED for old, new in zip(before.controlled, after.controlled, strict=True)) or lost
    )
    assert sum(after.let_go) <= sum(before.let_go)
    fewer = change.after.warnings < change.before.warnings
    asked = {user.name: user.asked_npm for user in now.users}
    if not lost and not fewer:
        assert missed(after, asked) <= missed(before, asked) + 0.02
        for topic in ("feel", "free motion", "stability", "passivity", "device"):
            assert level_of(then, topic) <= level_of(now, topic), topic
    heavier = max(new.free_mass_kg / old.free_mass_kg for old, new in zip(now.users, then.users, strict=True))
    assert heavier <= TOLD or "free motion is heavier" in change.effect
    pairs = [(npm, after.felt[name]) for name, npm in before.felt.items()]
    softer = max((old / new for old, new in pairs if old and new), default=1.0)
    assert softer <= TOLD or "contact is softer" in change.effect


def test_the_situations_are_many_kinds_and_each_has_a_model() -> None:
    settings = [situation(number) for number in range(SITUATIONS)]
    kinds = {(each.object.kind, each.coupling.kind) for each in settings}
    assert len(kinds) >= 6
    for each in settings[:8]:
        try:
            advise(each)
        except (ModelError, SettingsError) as error:
            raise AssertionError(f"{each.object.kind}, {each.coupling.kind}: {error}") from error
