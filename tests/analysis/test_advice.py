"""Tests of advice against its model, on both sides of every bound that warns."""

from typing import Any

import msgspec
import pytest

from cogrip.analysis.advice import advice_change
from cogrip.analysis.advice.advice import AMPLE, HEAVY_KG, Advice, advise, advise_seat, feel_level
from cogrip.analysis.advice.advice_change import Change, change_to, ranked_changes
from cogrip.analysis.advice.finding import growth, warning_rows
from cogrip.analysis.linear.linear_session import ModelError, form_overrides
from cogrip.analysis.linear.stability import Limit
from cogrip.client.safety.rendered_damper import rounded_down
from cogrip.devices.for_user import make_for
from cogrip.protocol.line.concealment import held_force
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError

from tests.extent import long
from tests.sim.session_measures import FRAME_MS


def settings_of(scheme: Any = "passive", **overrides: Any) -> Settings:
    people = [{"name": name, "device": "sim:ideal", "hand": "hold"} for name in ("a", "b")]
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return resolve({"users": people}, {**form_overrides(scheme), **keys})


def best_change(settings: Settings, now: Advice, *progress: Any) -> Change | None:
    return next(ranked_changes(settings, now, *progress), None)


def words(advice: Advice, topic: str) -> str:
    return " | ".join(finding.text for finding in advice.findings if finding.topic == topic)


def test_a_session_as_it_should_be_warns_of_nothing() -> None:
    advice = advise(settings_of())
    assert advice.warnings == ()
    assert "stable, and at any stiffness" in words(advice, "stability")
    assert "passive by construction" in words(advice, "passivity")


@pytest.mark.parametrize(("scheme", "frames", "limit"), [("paper", 0, 1977.675), ("coupling", 1, 1260.446)])
def test_a_margin_below_ample_warns_and_one_above_does_not(scheme: str, frames: int, limit: float) -> None:
    """The limits are those of docs/paper.md."""
    for share, warns in ((1.001, False), (0.999, True)):
        K = limit / AMPLE / share
        advice = advise(settings_of(scheme, coupling__stiffness_npm=K, link__delay_ms=frames * FRAME_MS))
        assert bool(advice.warnings) == warns
        assert "not passive" in words(advice, "passivity")


def test_an_unstable_session_says_up_to_where_it_is_stable() -> None:
    advice = advise(settings_of("paper", coupling__stiffness_npm=2500.0))
    assert "the linear model predicts growth, twofold every " in advice.warnings[0]
    assert "at K = 2500 N/m (spectral radius 1." in advice.warnings[0]
    assert "none up to 1978 N/m" in advice.warnings[0]
    assert not advice.verdict.stable


@pytest.mark.parametrize(
    ("each_second", "words"),
    [(1.0, "growth of 0 % per second"), (1.042, "growth of 4.2 % per second"), (1.999, "growth of 100 % per second"),
     (2.1, "growth, twofold every 930 ms,"), (2.0**50, "growth, twofold every 20 ms,")],
)  # fmt: skip
def test_growth_is_said_by_the_second_while_it_is_slow(each_second: float, words: str) -> None:
    for frame_s in (1 / 128, 1 / 64):
        assert growth(each_second**frame_s, frame_s) == words


def test_the_device_bound_from_both_sides() -> None:
    """With 0.1 kg b T_c / m = 1 at b = 102.4; the record of an ideal device advises half of that."""
    below, above = (advise(settings_of(coupling__impedance_nspm=b)) for b in (51.0, 51.4))
    assert below.warnings == ()
    assert len(above.warnings) == 2
    assert "b = 51.4 N s/m is more than device sim:ideal carries: b T_c / m = 0.50" in above.warnings[0]
    assert "set coupling.impedance_nspm to 51.2 or less" in above.warnings[0]


def test_felt_more_than_the_record_advises() -> None:
    device = {"users__0__device": "sim:phantom?hand=hold", "coupling__impedance_nspm": 50.0}
    quiet, loud = (advise(settings_of(**device, coupling__stiffness_npm=K)) for K in (1060.0, 1120.0))
    assert not any("record" in text for text in quiet.warnings)
    assert any("felt 1030" in text and "1000 N/m" in text for text in loud.warnings)


@pytest.mark.parametrize(
    ("stiffness_npm", "level", "fastest"),
    [
        (3000.0, None, None),
        (3400.0, "note", "0.29 m/s"),
        (9000.0, "note", "0.11 m/s"),
        (11000.0, "warning", "0.091 m/s"),
    ],
)
def test_a_wall_that_the_motors_cannot_follow_is_said(
    stiffness_npm: float, level: str | None, fastest: str | None
) -> None:
    """A force rises by 1000 N/s at most, and hands touch with 0.3 m/s, with care with 0.1."""
    local = settings_of(object__kind="wall", coupling__kind="local", coupling__stiffness_npm=stiffness_npm)
    said = [each for each in advise(local).findings if "1000 N/s" in each.text]
    assert [each.level for each in said] == ([level] * 2 if level else [])
    assert all(f"met faster than {fastest} would" in each.text for each in said)


def test_what_the_device_port_takes_of_a_contact_is_said() -> None:
    """A damper that is four ticks late carries K l T < B: 25.6 / 3.9 ms."""
    device = {"users__0__device": "sim:phantom?hand=hold", "object__kind": "wall", "coupling__kind": "local"}
    most_npm = 25.6 / (4.0 / 1024.0)
    for share, said in ((0.999, False), (1.001, True), (2.0, True)):
        findings = advise(settings_of(coupling__stiffness_npm=share * most_npm, **device)).findings
        found = [each for each in findings if "the device port renders 6554 N/m at most" in each.text]
        assert [each.level for each in found] == (["note"] if said else [])


@pytest.mark.parametrize(("decimator", "level"), [("boxcar", "ok"), ("lowpass", "note"), ("none", "warning")])
def test_what_a_decimator_may_make(decimator: str, level: str) -> None:
    advice = advise(settings_of(coupling__decimator=decimator))
    assert {finding.level for finding in advice.findings if finding.topic == "passivity"} == {level}


def test_up_to_which_force_the_credit_holds_a_hand_through_gaps() -> None:
    """Theory 3.5: F = sqrt(4 b E / (T_n axes (n + f^2 / (1 - f^2)))); what is said to be enough holds what is asked for."""
    phantoms = {f"users__{number}__device": "sim:phantom?hand=hold" for number in (0, 1)}
    lossy = {"link__loss": 0.01, "playout__tank_mj": 1.0, **phantoms}
    said = words(advise(settings_of(**lossy)), "gaps")
    assert "0.77 N are held in full" in said
    enough = float(said.rsplit("tank_mj = ", 1)[1])
    wanted = float(said.split("the ", 1)[1].split(" N that the device")[0])
    assert held_force(20.0, enough * 1e-3, 1.0 / 128.0, 1) == pytest.approx(wanted, rel=0.03)
    rich = advise(settings_of(**{**lossy, "playout__tank_mj": 1.1 * enough}))
    assert {finding.level for finding in rich.findings if finding.topic == "gaps"} == {"ok"}
    assert words(advise(settings_of()), "gaps") == ""


def test_compensation_possible_or_which_impedance_would_do() -> None:
    near, far = (advise(settings_of(link__delay_ms=ms, coupling__stiffness_npm=1000.0)) for ms in (7.8125, 23.4375))
    assert near.users[0].compensated_npm == pytest.approx(1.0 / (1e-3 - 3 * 7.8125e-3 / 40.0), rel=1e-6)
    assert "compensation is possible" in words(near, "feel")
    assert far.users[0].compensated_npm is None
    assert far.users[0].enough_impedance_nspm == pytest.approx(1000.0 * 7 * 7.8125e-3 / 2.0, rel=1e-6)
    assert "b > 27.3 would do" in words(far, "feel")
    assert far.users[0].felt_npm == pytest.approx(422.4, abs=0.05)


@pytest.mark.parametrize(
    ("asked_npm", "felt_npm", "level"),
    [
        (1000.0, 770.0, "ok"), (1000.0, 769.0, "note"), (1000.0, 250.0, "note"), (1000.0, 249.0, "warning"),
        (1000.0, 1230.0, "ok"), (1000.0, 1231.0, "note"), (1000.0, 212.0, "warning"),
    ],
)  # fmt: skip
def test_a_felt_stiffness_that_a_hand_tells_apart_is_not_ok(asked_npm: float, felt_npm: float, level: str) -> None:
    assert feel_level(felt_npm, asked_npm) == level


@pytest.mark.parametrize(("delay_ms", "level"), [(0.0, "ok"), (7.8125, "ok"), (15.625, "note"), (23.4375, "note")])
def test_free_motion_that_the_line_makes_heavy_is_not_ok(delay_ms: float, level: str) -> None:
    """Free motion feels m + b (2 d + 1) T_n / 2 (theory section 7.1), beside the device's own 0.1 kg."""
    advice = advise(settings_of(link__delay_ms=delay_ms))
    [found] = {finding.level for finding in advice.findings if finding.topic == "free motion"}
    frames = 2.0 * delay_ms / 7.8125 + 1.0
    added_kg = advice.users[0].free_mass_kg - 0.1
    assert added_kg == pytest.approx(0.5 * 20.0 * frames * 7.8125e-3, rel=0.15)
    assert found == level == ("note" if added_kg > HEAVY_KG else "ok")


def test_compensation_that_would_not_be_stable_is_not_called_possible() -> None:
    """K = 660 at 20 ms takes 4400 N/m: possible where the session is stable so far, or at any stiffness."""
    settings = settings_of(link__delay_ms=20.0, coupling__stiffness_npm=660.0)
    compensated_npm = advise(settings).users[0].compensated_npm
    assert compensated_npm is not None
    for share, said in ((None, "is possible"), (1.001, "is possible"), (0.999, "which is not stable")):
        limit = Limit(None if share is None else share * compensated_npm, 1e7)
        assert said in words(advise(settings, lambda model, limit=limit: limit), "feel")


def test_a_seat_alone_hears_the_same_words_as_its_room() -> None:
    settings = settings_of(coupling__impedance_nspm=60.0)
    room = advise(settings)
    record = make_for(settings.users[0], 1).capability
    seat = advise_seat(seat_settings(settings, 0), record)
    assert seat.warnings[0] == room.warnings[0]


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("scheme", "overrides", "key"),
    [
        ("coupling", {"coupling.stiffness_npm": 4000.0, "link.delay_ms": 15.625}, "coupling.kind"),
        ("paper", {"coupling.stiffness_npm": 4000.0, "link.delay_ms": 15.625}, "coupling.server_step"),
        ("passive", {"coupling.decimator": "none"}, "coupling.decimator"),
        ("passive", {"coupling.impedance_nspm": 150.0}, "coupling.impedance_nspm"),
        ("passive", {}, "coupling.compensate"),
    ],
)
def test_the_change_that_helps_most_is_one_that_was_tried(scheme: Any, overrides: dict[str, Any], key: str) -> None:
    keys = {name.replace(".", "__"): value for name, value in overrides.items()}
    settings = settings_of(scheme, **keys)
    before = advise(settings)
    change = best_change(settings, before)
    assert change.key == key
    after = advise(settings_of(scheme, **{**keys, key.replace(".", "__"): change.value}))
    assert change.after.warnings <= change.before.warnings
    assert [finding for finding in after.findings if finding.refused] == []


@pytest.mark.sample(1)
@pytest.mark.parametrize(("b", "setting"), [(20.0, "coupling.impedance_nspm=25.6"), (25.6, "playout.frames=0")])
def test_slack_against_jitter_is_given_up_last(b: float, setting: str) -> None:
    """The largest b that the device carries, 25.6 N s/m, gives as much felt stiffness."""
    people = [{"name": name, "device": "sim:phantom?hand=hold"} for name in ("a", "b")]
    table = {"coupling": {"impedance_nspm": b}, "link": {"delay_ms": 20.0}, "playout": {"frames": 1}, "users": people}
    change = best_change(resolve(table), advise(resolve(table)))
    assert change.setting == setting


def test_a_change_that_trades_says_what_it_costs() -> None:
    """K m = b^2 (theory 7.1): what a larger b gives in stiffness it takes in mass."""
    settings = settings_of(coupling__impedance_nspm=3.0, link__delay_ms=100.0, coupling__stiffness_npm=1000.0)
    change = best_change(settings, advise(settings))
    assert change.key == "coupling.impedance_nspm"
    after = advise(resolve(msgspec.to_builtins(settings), change.overrides))
    before = advise(settings)
    felt_npm, free_kg = (
        [getattr(each.users[0], key) for each in (after, before)] for key in ("felt_npm", "free_mass_kg")
    )
    assert f"({felt_npm[0]:.3g} N/m in place of {felt_npm[1]:.3g})" in change.effect
    heavier = f"it costs: free motion is heavier ({free_kg[0]:.3g} kg in place of {free_kg[1]:.3g})"
    assert heavier in change.effect
    assert after.users[0].free_mass_kg > 5.0 * before.users[0].free_mass_kg


def test_a_change_that_makes_a_level_worse_is_not_given() -> None:
    """At 6 ms the line adds 0.23 kg with b = 20, and with all that the device carries more than 0.25 kg."""
    device = {f"users__{number}__device": "sim:phantom?hand=hold" for number in (0, 1)}
    settings = settings_of(link__delay_ms=6.0, coupling__stiffness_npm=10000.0, **device)
    now = advise(settings)
    assert {finding.level for finding in now.findings if finding.topic == "free motion"} == {"ok"}
    for change in ranked_changes(settings, now):
        after = advise(resolve(msgspec.to_builtins(settings), change.overrides))
        assert {finding.level for finding in after.findings if finding.topic == "free motion"} == {"ok"}
        assert (change.key, change.value) != ("coupling.impedance_nspm", 25.6)


@pytest.mark.parametrize(("kind", "tried"), [("wall", True), ("faces", False), ("cube", False)])
def test_local_contact_is_tried_where_it_fits(kind: str, tried: bool) -> None:
    settings = settings_of(object__kind=kind, link__delay_ms=100.0, coupling__stiffness_npm=1000.0)
    change = best_change(settings, advise(settings))
    assert (change.setting == 'coupling.kind="local"') == tried
    if tried:
        assert "(1000 N/m in place of " in change.effect
        assert "it costs: a wall that moves" in change.effect
        assert change.after.missed == pytest.approx(0.0, abs=1e-9)


def test_local_contact_comes_with_a_damper_and_a_spring_that_the_devices_carry() -> None:
    device = {f"users__{number}__device": "emulated:vintage?hand=hold" for number in (0, 1)}
    settings = settings_of(
        object__kind="wall", link__delay_ms=100.0, coupling__impedance_nspm=2.0, coupling__damping_nspm=40.0, **device
    )
    now = advise(settings)
    changes = {change.value: change for change in ranked_changes(settings, now)}
    carried, advised = (
        rounded_down(each) for each in (now.users[0].largest_impedance_nspm, now.users[0].advised_stiffness_npm)
    )
    assert carried < 40.0
    assert advised < 1000.0
    also = f"--set coupling.damping_nspm={carried} --set coupling.stiffness_npm={advised}"
    assert changes["local"].setting == f'coupling.kind="local" {also}'
    assert advise(resolve(msgspec.to_builtins(settings), changes["local"].overrides)).refusals == ()


def test_warnings_are_counted_as_they_are_printed() -> None:
    """One of the decimator and one of the feel, each of both people; two of the one whose damper is too large."""
    settings = settings_of(
        coupling__decimator="none", link__delay_ms=100.0, coupling__stiffness_npm=2000.0, users__0__impedance_nspm=60.0
    )
    now = advise(settings)
    people = [user.name for user in settings.users]
    assert warning_rows(now.findings, people) == 5, "the feel of the two is not the same"
    change = change_to(settings, now, "coupling.decimator", "boxcar")
    assert (change.before.rows, change.after.rows) == (5, 3)
    assert "2 of 5 warnings would go" in change.effect


def test_where_nothing_would_be_better_nothing_is_said() -> None:
    settings = settings_of(coupling__compensate=True)
    assert best_change(settings, advise(settings)) is None


@pytest.mark.parametrize(
    ("device", "b", "bound"),
    [
        ("sim:phantom?hand=hold", 20.0, "its lag bound, where the 4 ticks"),
        ("sim:phantom?hand=hold&resolution_m=0.0001", 20.0, "its noise bound, one count of 0.1 mm"),
        ("sim:ideal", 20.0, "its record bound, where the damping"),
    ],
)
def test_words_name_the_bound(device: str, b: float, bound: str) -> None:
    advice = advise(settings_of(users__0__device=device, users__1__device=device, coupling__impedance_nspm=b))
    assert bound in words(advice, "device")
    assert advice.users[0].impedance_bound == bound.split()[1]


@pytest.mark.long
@pytest.mark.parametrize(
    "overrides",
    [
        {"coupling.kind": "coupling", "link.delay_ms": 20.0},
        long({"coupling.decimator": "none", "users.0.device": "sim:ideal"}),
        long({"coupling.impedance_nspm": 45.0, "link.profile": "wan"}),
    ],
)
def test_who_looks_at_the_most_hopeful_first_finds_what_who_looks_at_all_finds(overrides: dict[str, Any]) -> None:
    """Every candidate with its whole limit, as the definition of the best one says."""
    settings = resolve({"users": [{"name": "a"}, {"name": "b"}]}, overrides)
    now = advise(settings)
    asked = [user.asked_npm for user in now.users]
    table = msgspec.to_builtins(settings)
    best, found = advice_change.score_of(now, asked).key(), None
    for key, value in advice_change.candidates_of(settings, now):
        try:
            after = advice_change.score_of(advise(resolve(table, {key: value})), asked).key()
        except (SettingsError, ModelError):
            continue
        if after < best:
            best, found = after, (key, value)
    tried: list[int] = []
    change = best_change(settings, now, lambda number, total: tried.append(number))
    assert (None if change is None else (change.key, change.value)) == found
    assert tried == list(range(len(tried)))
    assert len(tried) > 10


def test_a_session_without_a_model_is_an_error() -> None:
    with pytest.raises(ModelError):
        advise(settings_of("paper", object__kind="faces"))


def test_effects_that_a_device_does_not_render_as_asked_are_noted() -> None:
    wrong = {
        "effects": [
            {"kind": "viscous", "damping_nspm": 30.0},
            {"kind": "vibration", "amplitude_n": 5.0, "frequency_hz": 100.0, "direction": (1.0, 0.0, 0.0)},
            {"kind": "zone", "stiffness_npm": 5e4, "direction": (1.0, 0.0, 0.0)},
            {"kind": "texture", "amplitude_n": 20.0, "period_m": 0.001, "direction": (1.0, 0.0, 0.0)},
            {"kind": "constant", "force_n": 6.0, "direction": (1.0, 0.0, 0.0)},
            {"kind": "perturbation", "amplitude_n": 4.0, "seconds": 0.01, "direction": (1.0, 0.0, 0.0)},
        ]
    }
    [found] = [each for each in advise(resolve(wrong)).findings if each.topic == "effects"]
    assert found.level == "note"
    bounds = (
        "damping_nspm = 30, of which at most 5.6",
        "= 5, of which at most 1.59",
        "= 50000, of which at most 6554",
        "= 20, of",
        "force_n = 6, of which at most 5.12, what a full tank pays for",
        "amplitude_n = 4, of which at most 3.11",
    )
    assert [said for said in bounds if said not in found.text] == []
    spring = {"kind": "spring", "stiffness_npm": 200.0}
    right = {"effects": [{"kind": "viscous", "damping_nspm": 5.0}, spring]}
    [found] = [each for each in advise(resolve(right)).findings if each.topic == "effects"]
    assert found.level == "ok"
