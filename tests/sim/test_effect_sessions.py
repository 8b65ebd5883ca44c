"""Sessions with haptic effects: felt as told on every network, passive, gone with seat and link, refused by name."""

import tomllib
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.cli.settings.shipped_settings import shipped
from cogrip.client.core import ClientCore
from cogrip.protocol.settings.effects import LEAST_EVERY_S, MOST_EFFECTS, Effect
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import SettingsError, resolve
from cogrip.results.verdict.verdict import judgements
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.sim.session_measures import account_of, by_tick, laboratory_of, run_frames

ZONE: dict[str, Any] = {
    "kind": "zone", "place_m": (-0.03, 0.0, 0.0), "direction": (-1.0, 0.0, 0.0), "stiffness_npm": 600.0, "damping_nspm": 5.0,
}  # fmt: skip
INTO_ZONE = "waypoints&times_s=0,0.8,1.2,1.8&x_m=0,-0.06,-0.06,-0.02"
BUZZ = Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=0.3, frequency_hz=80.0)
HOLDING: dict[str, Any] = {
    "object": {"kind": "wall"},
    "coupling": {"kind": "local"},
    "users": [{"name": "anna", "hand": "hold"}],
}


def session(seconds: float, *effects: dict[str, Any], hand: str = "hold", **more: Any) -> Laboratory:
    """Return a session of one hand before a wall that it does not reach."""
    users = [{"name": "anna", "hand": hand}]
    return laboratory_of(**{**HOLDING, "seconds": seconds, "effects": list(effects), "users": users, **more})


def core_of(laboratory: Laboratory) -> ClientCore:
    return laboratory.people[0].core


@pytest.mark.sample(1)
@pytest.mark.parametrize("network", every(3, PROFILES))
def test_zone_feels_as_stiff_as_asked_on_every_network(network: str) -> None:
    laboratory = session(3.2, ZONE, hand=INTO_ZONE, link={"profile": network, "loss": 0.05})
    core = core_of(laboratory)
    depth, force = np.mean(by_tick(laboratory, lambda _: (core.position_m[0] + 0.03, core.force_n[0]))[3101:], axis=0)
    assert depth > 1e-3
    assert force / depth == pytest.approx(600.0, rel=0.03)
    assert account_of(laboratory).device.margin_j >= 0.0


def test_all_six_at_once_are_passive_stable_and_felt() -> None:
    table = tomllib.loads(shipped("effects").read_text(encoding="utf-8"))
    laboratory = Laboratory(resolve(table))
    account_of(laboratory)
    summary = of_laboratory(laboratory)
    assert [each.tone for each in judgements(summary)] == ["good"] * 3
    user = summary["users"][0]
    assert user["energy"]["device_margin_j"] >= 0.0
    assert user["effects"]["least_tank_j"] >= 0.0
    assert user["effects"]["drawn_j"] > 0.0
    assert user["peak_force_n"] > 1.0
    assert not user["oscillates"]


def test_effects_come_through_heavy_loss_and_are_told_no_more_once_known() -> None:
    effects = [{**ZONE, "stiffness_npm": 100.0 + place} for place in range(MOST_EFFECTS)]
    laboratory = session(3.0, *effects, link={"delay_ms": 40.0, "loss": 0.3})
    laboratory.run()
    rendered, told = core_of(laboratory).seated, laboratory.room.seats[0].effects
    assert rendered.effects.known(range(1, 17)) == tuple(range(1, 17))
    assert all(told.next(1, step) is None for step in range(1024))


def test_world_begins_and_ends_effects_and_the_hand_feels_a_burst_in_its_time() -> None:
    laboratory = session(2.5)
    world, burst = laboratory.room.world, msgspec.structs.replace(BUZZ, seconds=0.25)
    orders = {1024: (burst,), 1032: (), 1800: (BUZZ,), 2200: ()}  # one that ends by itself goes on
    acts = {tick: partial(setattr, world, "effects", effects) for tick, effects in orders.items()}
    felt = by_tick(laboratory, lambda now: abs(core_of(now).force_n[0]), acts)
    loud = [tick for tick, force in enumerate(felt) if force > 0.05]
    first = [tick for tick in loud if tick < 1700]
    assert 1024 <= first[0] <= 1060
    assert 230 <= first[-1] - first[0] <= 290
    assert 1800 <= next(tick for tick in loud if tick > 1700) <= 1840
    assert loud[-1] <= 2200 + 48


def test_an_effect_begins_anew_with_each_of_its_markers() -> None:
    burst = {name: getattr(BUZZ, name) for name in ("kind", "direction", "amplitude_n", "frequency_hz")}
    laboratory = session(4.0, {**burst, "marker": "go", "start_s": 0.25, "seconds": 0.25})
    marks = {1024: "go", 1056: "go", 1200: "stop", 2560: "go"}  # the second comes too soon
    acts = {tick: partial(laboratory.mark, text) for tick, text in marks.items()}
    felt = by_tick(laboratory, lambda now: abs(core_of(now).force_n[0]), acts)
    loud = [tick for tick, force in enumerate(felt) if force > 0.05]
    for begun, spell in (
        (1280, [tick for tick in loud if tick < 2560]),
        (2816, [tick for tick in loud if tick >= 2560]),
    ):
        assert begun <= spell[0] <= begun + 40
        assert 230 <= spell[-1] - spell[0] <= 290


CURL: dict[str, Any] = {"kind": "curl", "direction": (0.0, 0.0, 1.0), "damping_nspm": 4.0}
TO_AND_FRO = "reach&amplitude_m=0.08&stroke_s=0.5&direction=-1,0&hand_stiffness_npm=200"


@pytest.mark.sample(1)
@pytest.mark.parametrize("network", every(3, PROFILES))
def test_a_curl_field_is_there_for_ever_passive_and_steady_on_every_network(network: str) -> None:
    """Fourteen reaches to and fro before a wall, each pushed to its right by B v; its lag does not empty the tank."""
    laboratory = session(
        8.0, CURL, hand=TO_AND_FRO, link={"profile": network, "loss": 0.05}, object={"kind": "wall", "axes": 2}
    )
    core = core_of(laboratory)
    rows = np.array(by_tick(laboratory, lambda _: (*core.position_m, *core.force_n))[1024:])
    speed = np.gradient(rows[:, 0]) * 1024.0
    fast = np.abs(speed) > 0.15
    assert np.median(rows[fast, 3] / speed[fast]) == pytest.approx(4.0, rel=0.05)
    account = account_of(laboratory)
    assert account.device.margin_j >= 0.0
    assert not account.device.oscillates
    assert account.effects is not None
    assert account.effects.least_tank_j > 0.0
    assert account.effects.reduced_s == 0.0


def test_what_a_world_may_not_ask_for_is_refused_by_name_and_counted() -> None:
    laboratory = session(1.0)
    wrong: list[Any] = [
        Effect("viscous", damping_nspm=float("nan")),
        Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=1e9, frequency_hz=50.0),
        Effect("viscous"), Effect("path", points_m=((0.0, 0.0, 0.0),), stiffness_npm=1.0), "buzz",
        Effect("zone", place_m=(float("inf"), 0.0, 0.0), size_m=(1.0, 0.0, 0.0), stiffness_npm=1.0),
    ]  # fmt: skip
    many = [Effect("viscous", damping_nspm=1.0 + each) for each in range(1000)]
    laboratory.room.world.effects = tuple(wrong + many)
    laboratory.run()
    assert laboratory.server.dropped["effect refused"] == len(wrong) + 1000 - MOST_EFFECTS
    assert len(core_of(laboratory).seated.effects.known(range(2000))) == MOST_EFFECTS
    assert not core_of(laboratory).session.dropped


def test_effects_fade_with_the_link_and_with_the_seat() -> None:
    laboratory = session(2.5, {**ZONE, "place_m": (-0.1, 0.0, 0.0)}, link={"delay_ms": 5.0})
    laboratory.room.world.effects = (BUZZ,)
    felt = by_tick(laboratory, lambda now: core_of(now).force_n[0], {1024: laboratory.kill})
    assert max(map(abs, felt[800:1024])) > 0.2
    quiet = felt[1024 + 230 : 2048]  # silence of 0.1 s, then a ramp of 0.1 s
    assert not any(quiet)
    assert np.abs(np.diff(felt)).max() < 1.0


@pytest.mark.long
def test_effects_begin_anew_with_a_new_server() -> None:
    laboratory = session(4.0, {**ZONE, "place_m": (-0.005, 0.0, 0.0)}, link={"delay_ms": 5.0})
    run_frames(laboratory, 128)
    before = laboratory.kill()
    run_frames(laboratory, 20)
    laboratory.restart(before)
    laboratory.run()
    effects = core_of(laboratory).seated.effects
    assert len(effects._entries) == 1
    assert core_of(laboratory).safety.state == "live"
    assert effects.tank.overdrawn_j == 0.0


@pytest.mark.long
@pytest.mark.parametrize("frame", [{"position_scale": 2.0}, {"force_scale": 2.0}, {"rotation": "-x -y z"}])
def test_effects_are_of_the_tool(frame: dict[str, Any]) -> None:
    """A position scale g moves the tool g times as far, a force scale s makes it s times as stiff at the hand."""
    scale, force = frame.get("position_scale", 1.0), frame.get("force_scale", 1.0)
    side = -1.0 if "rotation" in frame else 1.0
    hand = f"waypoints&times_s=0,1,1.5,2&x_m=0,{-0.05 * side / scale},{-0.05 * side / scale},{-0.02 * side / scale}"
    users = [{"name": "anna", "hand": hand, **frame}]
    laboratory = session(3.2, {**ZONE, "stiffness_npm": 300.0}, users=users)
    core = core_of(laboratory)
    rows = by_tick(
        laboratory, lambda _: (core.seated.tool_pose()[0] + 0.03, side * core.force_n[0]) if core.seated else None
    )
    depth, felt = np.mean(rows[3101:], axis=0)
    assert felt / depth == pytest.approx(300.0 * force / scale, rel=0.03)


@pytest.mark.parametrize("on_s", [0.02, 0.05])
def test_a_zone_that_is_switched_as_fast_as_may_be_is_no_oscillation(on_s: float) -> None:
    laboratory = session(
        2.0, {**ZONE, "stiffness_npm": 300.0, "every_s": LEAST_EVERY_S, "seconds": on_s}, hand=INTO_ZONE
    )
    laboratory.run()
    account = account_of(laboratory)
    assert account.peak_force_n > 0.5
    assert (account.device.let_go, account.device.oscillates) == (0, False)


WRONG = [
    ({"kind": "viscous"}, "effects.0: kind = \"viscous\" needs damping_nspm above 0"),
    ({"kind": "vibration", "amplitude_n": 1.0, "frequency_hz": 50.0}, "needs a direction"),
    ({"kind": "vibration", "amplitude_n": 1e3, "frequency_hz": 50.0}, "at most 40"),
    ({"kind": "vibration", "amplitude_n": float("nan"), "frequency_hz": 50.0}, "effects.0.amplitude_n"),
    ({"kind": "path", "stiffness_npm": 100.0, "points_m": [(0.0, 0.0, 0.0)]}, "needs points_m"),
    ({"kind": "zone", "stiffness_npm": 100.0}, "fills everything"),
    ({"kind": "texture", "amplitude_n": 1.0, "period_m": 1e-6, "direction": (1.0, 0.0, 0.0)}, "below 0.0001"),
    ({**ZONE, "users": ["eve"]}, "there is no user 'eve'"),
    ({"kind": "gravity"}, "effects.0.kind"),
    ({"kind": "spring"}, "kind = \"spring\" needs stiffness_npm above 0"),
    ({"kind": "curl", "damping_nspm": 4.0, "direction": (0.0, 0.0, 1.0)}, "set object.axes to 2 or 3"),
    ({"kind": "channel", "stiffness_npm": 9.0, "points_m": [(0.0, 0.0, 0.0)] * 3}, "needs points_m: 2, each"),
    ({"kind": "constant", "force_n": 1.0}, "needs a direction"),
    ({"kind": "perturbation", "amplitude_n": 1.0, "seconds": 0.009, "direction": (1, 0, 0)}, "give at least 0.01"),
    ({"kind": "perturbation", "amplitude_n": 1.0, "direction": (1, 0, 0)}, "needs seconds above 0"),
    ({**ZONE, "marker": "m" * 81}, "effects.0.marker"),
    ({"kind": "zone", "stiffness_npm": 300.0, "direction": (1, 0, 0), "every_s": 0.099}, "effects.0: every_s = 0.099 of kind"),
]  # fmt: skip


@pytest.mark.parametrize(("effect", "said"), WRONG)
def test_settings_that_make_no_effect_are_refused(effect: dict[str, Any], said: str) -> None:
    with pytest.raises(SettingsError, match=said.replace("(", r"\(")):
        resolve({**HOLDING, "effects": [effect]})
