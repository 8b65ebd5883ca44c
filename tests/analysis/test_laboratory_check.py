"""Tests of advice against sessions: the feel on a link with jitter and loss, and the change that is proposed."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from statistics import mean
from typing import Any

import msgspec
import pytest

from cogrip.analysis.advice import laboratory_check
from cogrip.analysis.advice.advice import advise
from cogrip.analysis.advice.advice_change import Change, Score
from cogrip.analysis.advice.laboratory_check import Check, checked_change, checked_stiffest, words
from cogrip.analysis.advice.stiffest import SHARES, stiffest
from cogrip.analysis.feel import felt_probe as felt
from cogrip.devices.for_user import make_for
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings

from tests.extent import long

check, stiffest_of = cache(laboratory_check.check), cache(stiffest)
WIFI = {"link.profile": "wifi", "coupling.stiffness_npm": 500.0, "seconds": 0.5}
SLOW = {"rates.device_hz": 512}
SPRING = {**SLOW, "coupling.kind": "coupling", "link.delay_ms": 5.0}


def settings_of(overrides: dict[str, Any], **people: Any) -> Settings:
    users = [{"name": "anna", "hand": "reach"} | people, {"name": "ben", "hand": "hold"} | people]
    return resolve({"seconds": 1.0, "users": users}, overrides)


def settings_of_one(overrides: dict[str, Any]) -> Settings:
    """One person at a free object, whose felt stiffness cannot be measured: a check is one session."""
    table = {"seconds": 1.0, "rates": {"device_hz": 256}, "users": [{"name": "anna", "hand": "reach"}]}
    return resolve(table, overrides)


@pytest.fixture(scope="module", autouse=True)
def _each_once() -> Iterator[None]:
    """Look at the same settings once, with few seeds, short sessions and a short static load."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laboratory_check, "check", check)
        patch.setattr(laboratory_check, "stiffest", lambda settings, _: stiffest_of(settings))
        patch.setattr(laboratory_check, "MOST_SEEDS", 2)
        patch.setattr(laboratory_check, "SESSION_S", 2.0)
        patch.setattr(laboratory_check, "SHORT_S", 1.0)
        patch.setattr(felt, "SETTLE_S", 0.7)
        patch.setattr(felt, "LAST_S", 0.5)
        yield


@pytest.fixture
def no_load(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out what is felt, where the session alone is looked at."""
    monkeypatch.setattr(laboratory_check, "measure_felt", lambda settings: ())


@pytest.fixture(scope="module")
def wifi() -> tuple[Settings, Check]:
    settings = settings_of(WIFI)
    return settings, check(settings)


def test_on_a_link_without_chance_the_laboratory_feels_what_is_calculated() -> None:
    settings = settings_of({"link.delay_ms": 20.0})
    found = check(settings)
    for user in advise(settings).users:
        assert found.felt_npm[user.name] == pytest.approx((user.felt_npm,), rel=0.01)
    assert (found.passive, found.stable, found.session.level) == ("good", "good", "ok")


@pytest.mark.long
def test_jitter_and_loss_are_in_the_felt_stiffness(wifi: tuple[Settings, Check]) -> None:
    settings, found = wifi
    [first, *_] = advise(settings).users
    assert all(len(values) == laboratory_check.MOST_SEEDS for values in found.felt_npm.values())
    npm = [value for values in found.felt_npm.values() for value in values if value is not None]
    assert len(npm) == laboratory_check.MOST_SEEDS * len(found.felt_npm)
    assert mean(npm) < 0.95 * first.felt_npm
    assert {finding.level for finding in found.felt()} <= {"note", "warning"}
    assert (
        "calculated without the link's loss" in advise(settings).findings[3].text
    )  # the playout delay has the jitter in it
    fixed = msgspec.structs.replace(settings, playout=msgspec.structs.replace(settings.playout, frames=2))
    assert "calculated without the link's jitter and loss" in advise(fixed).findings[3].text


@pytest.mark.long
def test_a_change_that_only_the_model_likes_is_not_given(
    wifi: tuple[Settings, Check], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No playout on `wifi` makes the line short and its frames late: the model sees the first, a session both."""
    settings, found = wifi
    now = advise(settings)

    def offered(key: str, value: Any) -> Any:
        def changes(*_: Any) -> Iterator[Change]:
            after = advise(resolve({"users": [{"name": "anna"}, {"name": "ben"}]}, {**WIFI, key: value}))
            missed = [max(1.0 - user.felt_npm / 500.0 for user in one.users) for one in (now, after)]
            assert missed[1] < missed[0]
            yield Change(key, value, Score(0, 1.0, missed[0]), Score(0, 1.0, missed[1]))

        return changes

    monkeypatch.setattr(laboratory_check, "ranked_changes", offered("playout.frames", 0))
    assert checked_change(settings, now, found) is None
    monkeypatch.setattr(laboratory_check, "ranked_changes", offered("coupling.impedance_nspm", 25.6))
    given = checked_change(settings, now, found)
    assert given.after.missed < given.before.missed
    assert given.before.missed == found.missed({"anna": 500.0, "ben": 500.0})


@pytest.mark.long
def test_what_is_given_on_wifi_is_borne_out(wifi: tuple[Settings, Check]) -> None:
    settings, found = wifi
    asked = {"anna": 500.0, "ben": 500.0}
    given = checked_change(settings, advise(settings), found)
    assert given.key != "playout.frames"
    after = check(settings_of({**WIFI, given.key: given.value}))
    assert after.missed(asked) == pytest.approx(given.after.missed, abs=1e-12)
    assert given.after.missed < 0.97 * given.before.missed
    assert f"{100 * given.after.missed:.0f} %" in given.effect


@pytest.mark.usefixtures("no_load")
def test_a_session_that_oscillates_is_a_warning() -> None:
    oscillating = {"coupling.kind": "coupling", "link.delay_ms": 40.0, "coupling.stiffness_npm": 2000.0}
    found = check(settings_of(SLOW | oscillating))
    assert found.stable == "bad"
    assert found.session.level == "warning"
    assert "Not stable" in found.session.text or "Diverged" in found.session.text


@pytest.mark.usefixtures("no_load")
def test_hardware_has_a_stand_in_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_of({"coupling.impedance_nspm": 5.0})
    real = settings_of({"coupling.impedance_nspm": 5.0}, device="serial:/dev/null?variant=vintage")
    monkeypatch.setattr(laboratory_check, "make_for", lambda user, axes: make_for(settings.users[0], axes))
    found = check(real)
    assert found.stand_ins == ("anna", "ben")
    assert "a simulated device stood in for the hardware" in found.session.text


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ((363.4,), "felt like 363 N/m at rest over this link"),
        ((999.9, 1000.1), "felt like 1000 N/m at rest in 2 sessions over this link"),
        ((52.44, 71.0, 60.0), "felt like 52.4 to 71 N/m at rest in 3 sessions over this link"),
        ((52.4, None, 60.0), "never came to rest under a constant load in 3 sessions over this link"),
    ],
)
def test_words_of_what_was_felt(values: tuple[float | None, ...], expected: str) -> None:
    assert words(values) == expected


@pytest.mark.long
def test_nobody_with_a_load_has_nothing_to_miss(wifi: tuple[Settings, Check]) -> None:
    _, found = wifi
    alone = replace(found, felt_npm={})
    assert alone.missed({"anna": 500.0}) is None
    assert "was not measured" in alone.felt()[0].text
    assert replace(found, felt_npm={"anna": (None,)}).missed({"anna": 500.0}) == 1.0
    assert replace(found, felt_npm={"anna": (400.0, 200.0)}).missed({"anna": 500.0}) == pytest.approx(0.4)


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("overrides", "people"),
    [
        ({"link.delay_ms": 20.0}, {}),
        long({"link.delay_ms": 60.0}, {"device_mass_kg": 0.05}),
        ({**SLOW, "link.delay_ms": 5.0}, {"device": "emulated:vintage", "hand": "reach&amplitude_m=0.005"}),
        long(SPRING, {}),
        long({"users.0.stiffness_npm": 50.0, "coupling.compensate": True, "coupling.stiffness_npm": 100.0}, {}),
    ],
)
def test_the_stiffest_is_stable_felt_in_a_session_and_better_than_its_neighbours(
    overrides: dict[str, Any], people: dict[str, Any]
) -> None:
    settings = settings_of(overrides, **people)
    found = stiffest_of(settings)
    assert found.advice.warnings == () or all("N/m will feel like" in text for text in found.advice.warnings)
    there = settings_of({**overrides, **found.overrides}, **people)
    assert there == found.settings
    felt = check(there)
    assert felt.stable == "good"
    late_s = make_for(there.users[0], 1).capability.latency_ticks / there.rates.device_hz
    expected = 1.0 / (1.0 / found.felt_npm - 0.5 * late_s / found.damper_nspm)
    for values in felt.felt_npm.values():  # the load is on ideal devices, whose samples are not late
        assert values == pytest.approx((expected,), rel=0.02)
    key = next(iter(found.overrides))
    for share in (0.5, 0.8, 0.95):
        for stretch in (0.5, 0.9):
            spring_npm = found.stiffness_npm * stretch
            other = {**found.overrides, key: found.damper_nspm * share, "coupling.stiffness_npm": spring_npm}
            other |= {name: spring_npm for name in other if name.endswith("0.stiffness_npm")}
            users = advise(settings_of({**overrides, **other}, **people)).users
            assert min(user.felt_npm for user in users) <= found.felt_npm


def test_no_b_that_is_stable_is_none() -> None:
    looked: list[int] = []
    settings = settings_of({"coupling.server_step": "paper", "link.delay_ms": 20.0})
    assert stiffest(settings, lambda tried, total: looked.append(tried)) is None
    assert looked == list(range(len(SHARES)))


@pytest.mark.long
def test_a_stiffest_that_sessions_do_not_bear_out_comes_down(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = settings_of({"link.delay_ms": 20.0})
    first = stiffest_of(settings)
    seen: list[float] = []

    def judged(tried: Settings) -> Check:
        spring_npm = tried.coupling.stiffness_npm
        seen.append(spring_npm)
        return replace(good, stable="good" if spring_npm < 0.65 * first.stiffness_npm else "bad")

    good = check(settings)
    monkeypatch.setattr(laboratory_check, "check", judged)
    found, checked = checked_stiffest(settings)
    assert seen == pytest.approx([first.stiffness_npm * share for share in (1.0, 0.7, 1.0, 0.6)], rel=0.02)
    assert (found.bounded, checked.stable, found.stiffness_npm) == ("sessions", "good", seen[-1])
    assert found.felt_npm < first.felt_npm
    assert settings_of({"link.delay_ms": 20.0, **found.overrides}) == found.settings
    monkeypatch.setattr(laboratory_check, "check", lambda tried: replace(good, passive="bad"))
    assert checked_stiffest(settings) is None
    assert checked_stiffest(settings_of(SPRING)) is not None  # that is not passive by nature


@pytest.mark.long
def test_over_a_satellite_the_stiffest_is_one_that_a_session_bears_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The device carries b = 25.6 by its own bound; over a loop of 0.6 s its motors then give energy."""
    monkeypatch.setattr(laboratory_check, "SESSION_S", 6.0)
    found, checked = checked_stiffest(settings_of({"link.profile": "satellite", "seconds": 6.0}))
    assert (checked.passive, checked.stable) == ("good", "good")
    assert found.advice.verdict.stable


@pytest.mark.parametrize(
    ("overrides", "seconds", "beyond"),
    [
        long({"seconds": 30.0}, 2.0, ""),
        ({"seconds": 0.5}, 0.5, "less than 1 s"),
        long({"seconds": 30.0, "link.outage_s": 1.0, "link.outage_every_s": 8.0}, 11.0, ""),
        long({"seconds": 60.0, "link.outage_s": 1.0, "link.outage_every_s": 40.0}, 20.0, "begins at 41 s"),
        ({"seconds": 30.0, "link.outage_s": 1.0, "link.outage_every_s": 120.0}, 2.0, ""),
        ({"seconds": 30.0, "link.outages": [[3.0, 0.5]]}, 5.5, ""),
        long({"seconds": 30.0, "users.0.hand": "reach&delay_s=7"}, 9.0, ""),
    ],
)
def test_a_session_reaches_what_begins_late_or_says_that_it_does_not(
    overrides: dict[str, Any], seconds: float, beyond: str
) -> None:
    found = check(settings_of_one(overrides))
    assert found.seconds == seconds
    assert beyond in found.beyond
    assert bool(found.beyond) == bool(beyond)
    assert (found.session.level == "ok") == (not beyond and found.said == ())


@pytest.mark.usefixtures("no_load")
def test_outages_that_break_a_session_are_noted() -> None:
    outages = {"link.delay_ms": 20.0, "link.outage_s": 1.0, "link.outage_every_s": 1.2}
    found = check(settings_of({"seconds": 2.5, **outages}))
    assert found.session.level == "note"
    assert "of the frames" in found.session.text


def test_where_nothing_was_felt_the_change_is_the_models() -> None:
    alone = settings_of_one({"link.delay_ms": 20.0, "coupling.impedance_nspm": 10.0})
    given = checked_change(alone, advise(alone), check(alone))
    assert not given.measured
