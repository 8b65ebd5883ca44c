"""Tests of the measures of compared methods, against known traces and theory."""

import math
from itertools import product
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.analysis.feel import felt_probe as felt_module
from cogrip.analysis.feel.felt_probe import LOAD_N, ProbedStiffness, balanced_loads, furthest_off, measure_felt
from cogrip.analysis.feel.trace import SessionTrace, sketch
from cogrip.devices.registry import make
from cogrip.experiments.experiment import Result, run_case
from cogrip.experiments.methods.case import measure_case, run_session
from cogrip.experiments.methods.hand import FADE_S, RestingHand, let_rest
from cogrip.experiments.methods.measures import (
    ACTIVE_SHARE,
    COLUMNS,
    LAST_S,
    SWING_MJ,
    SWING_N,
    at_rest,
    created_at_rest_j,
    created_j,
    force_error_n,
    furthest,
    is_active,
    is_oscillating,
    put_in_j,
    swing_n,
)
from cogrip.experiments.methods.method import (
    CLEAN,
    METHODS,
    NETWORKS,
    OWN,
    ChoiceError,
    choose,
    ideal_settings,
    methods_of,
    session_settings,
)
from cogrip.experiments.methods.query import prepare
from cogrip.protocol.settings.room import coupling_of, rates_of, resolve

from tests.experiments.compared_methods import FREE, TWO, small
from tests.extent import every, long
from tests.sim.session_measures import FRAME_MS

pytestmark = pytest.mark.usefixtures("felt_once")

HELD = methods_of(resolve(TWO))
"""Methods that a cube has."""


# Measures of known traces


def test_energy_is_created_where_more_comes_out_than_went_in() -> None:
    work = np.array([0.0, 1.0, 1.0, 0.5, 2.0])
    assert created_j(work, np.array([0.0, 1.0, 0.5, 0.5, 2.0])) == 0.0
    assert created_j(work, np.array([0.0, 1.0, 0.5, 0.8, 2.1])) == pytest.approx(0.3)
    assert created_j(-work, np.zeros(5)) == 2.0
    assert created_j(np.zeros(0), np.zeros(0)) == 0.0


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(0, 1)), min_size=1, max_size=20))
def test_what_spends_only_what_came_in_creates_nothing(steps: list[tuple[float, float]]) -> None:
    """A store that is filled by the hands' work and gives a share of what it has to the object never owes."""
    store, work, given_out = 0.0, [0.0], [0.0]
    for power, share in steps:
        power = max(power, -store)  # it gives back what it has at most
        store += power
        given = share * max(store, 0.0)
        store -= given
        work.append(work[-1] + power)
        given_out.append(given_out[-1] + given)
    assert created_j(np.array(work), np.array(given_out)) <= 1e-12


def test_distances_swings_and_errors_are_what_they_say() -> None:
    time = np.arange(1000) / 1000.0
    three = np.zeros((1000, 3, 1))
    three[:, 1, 0] = 2e-3 * np.sin(2 * math.pi * time)
    three[:, 2, 0] = 1e-3
    rms, most = furthest(three)
    assert most == pytest.approx(3e-3, rel=1e-4)
    assert rms == pytest.approx(math.sqrt(2e-6 + 1e-6), rel=1e-4)  # of the second and the third
    assert furthest(three[:, :1]) == (0.0, 0.0)
    flat = np.ones((10, 2, 3))
    assert furthest(np.concatenate((flat, 0 * flat), axis=1))[0] == pytest.approx(math.sqrt(3))
    assert swing_n(three) == pytest.approx(4e-3, rel=1e-4)
    assert force_error_n(flat, flat) == 0.0
    assert force_error_n(flat, flat[:4] + 2.0) == pytest.approx(2 * math.sqrt(3))  # over what both have
    assert force_error_n(flat, flat[:0]) is None


def test_a_sketch_keeps_every_extreme() -> None:
    force = np.zeros((10_240, 2, 1))
    force[5000, 1], force[5001, 1] = 7.0, -9.0
    first, second = sketch(force)
    assert len(first) == len(second) <= 500
    assert (min(first), max(first), min(second), max(second)) == (0.0, 0.0, -9.0, 7.0)
    assert sketch(force[:3, :, :]) == [[0.0] * 6] * 2
    assert sketch(force[:0]) == []


def test_rest_is_judged_over_the_last_part_alone() -> None:
    frames, ticks = 256, 2048
    position, force = np.zeros((frames, 2, 1)), np.zeros((ticks, 2, 1))
    position[: frames - round(LAST_S * 128), 1] = 0.1
    force[: ticks - round(LAST_S * 1024)] = 5.0
    trace = SessionTrace(1 / 128, force, position, position, position[:, 0], np.zeros(frames), np.zeros(frames))
    assert at_rest(trace) == (0.0, 0.0)
    assert created_at_rest_j(trace) == 0.0
    position[-1, 0] = 64e-3
    force[-1] = -1.5
    trace.work_j[10:] = -2.0
    trace.work_j[-1] = -2.5
    assert at_rest(trace) == (pytest.approx(1e-3), 1.5)
    assert created_at_rest_j(trace) == 0.5


def test_oscillation_needs_swing_and_energy_and_activity_energy_beyond_a_share_of_the_work() -> None:
    assert is_oscillating(2 * SWING_N, 2 * SWING_MJ)
    assert not is_oscillating(0.99 * SWING_N, 2 * SWING_MJ)
    assert not is_oscillating(2 * SWING_N, 0.99 * SWING_MJ), "a long line rings"
    assert is_active(1.01 * SWING_MJ, 0.0)
    assert not is_active(0.99 * SWING_MJ, 0.0)
    assert is_active(1.01 * ACTIVE_SHARE * 1e3, 1e3)
    assert not is_active(0.99 * ACTIVE_SHARE * 1e3, 1e3), "much, but not against what hands did"


def test_what_hands_put_in_is_counted_whatever_comes_out_again() -> None:
    assert put_in_j(np.array([0.5, 1.0, 0.2, 0.2, 0.9])) == pytest.approx(0.5 + 0.5 + 0.7)
    assert put_in_j(np.array([-1.0, -2.0])) == 0.0
    assert put_in_j(np.zeros(0)) == 0.0


# Hands


@pytest.mark.parametrize("hand", ["reach", "tremor&amplitude_m=0.03", "sine&frequency_hz=2", "push&force_n=2", "hold"])
@pytest.mark.parametrize("x0", [0.0, 0.01])
def test_a_hand_comes_to_rest_where_it_began(hand: str, x0: float) -> None:
    """Put back into the equation: drive = K x_int + B v_int (+ push), and v_int is the slope of x_int."""
    rate = 1024
    bare, device = (make(f"sim:ideal?hand={hand}&x0_m={x0}", axes=1) for _ in range(2))
    for each in (bare, device):
        each.open(rate)
    assert let_rest(device, rate, 1.0) == (x0,)
    resting, inner = device.hand, bare.hand
    first, last = rate, rate + round(FADE_S * rate)
    for tick in (0, 1, 500, first - 1):
        assert resting.drive(tick) == inner.drive(tick)
        assert resting.intended(tick) == inner.intended(tick)
    for tick in range(first, last + 10):
        (x,), (v,) = resting.intended(tick)
        if not hand.startswith("push"):
            assert resting.drive(tick)[0] == pytest.approx(
                resting.stiffness_npm * x + resting.damping_nspm * v, abs=1e-9
            )
        slope = 0.5 * rate * (resting.intended(tick + 1)[0][0] - resting.intended(tick - 1)[0][0])
        assert v == pytest.approx(slope, abs=2e-3)
    for tick in (last, last + 1, 5 * rate):
        assert resting.intended(tick) == ((x0,), (0.0,))
        assert tuple(resting.drive(tick)) == (resting.stiffness_npm * x0,)


def test_only_a_simulated_hand_can_be_made_to_rest() -> None:
    with pytest.raises(TypeError, match="no simulated device"):
        let_rest(object(), 1024, 1.0)
    hand = RestingHand(make("sim:ideal?hand=hold", axes=1).hand, (0.0,), 1024, 1.0)
    assert hand.open(1024, None) == (0.0,)


# Settings of a session


def test_a_method_stands_above_a_users_own_settings() -> None:
    base = msgspec.to_builtins(resolve(TWO))
    for name in ("wave", "paper", "coupling", "tdpa"):
        settings = session_settings(base, name, "wan", 5)
        wanted = [(key.split("."), value) for key, value in METHODS[name].overrides.items()]
        for user, ((section, key), value) in product(settings.users, wanted):
            assert section != "coupling" or getattr(coupling_of(settings, user), key) == value
        assert settings.seed == 5
        assert settings.link.profile == "wan"
    assert session_settings(base, "wave", CLEAN, 5).link == resolve({}).link
    with_link = {**base, "link": {"delay_ms": 7.0}}
    assert session_settings(with_link, "wave", OWN, 5).link.delay_ms == 7.0
    assert ideal_settings(with_link, 5).rates.network_hz == 512
    assert ideal_settings(with_link, 5).link.delay_ms is None


def test_a_seed_is_the_same_hands_for_every_method_and_others_for_another() -> None:
    base = msgspec.to_builtins(resolve({**TWO, "users": [{"name": n, "hand": "tremor&seed=3"} for n in "ab"]}))
    hands = {
        seed: [tuple(user.hand for user in session_settings(base, method, "lan", seed).users) for method in HELD]
        for seed in (1, 2)
    }
    assert len(set(hands[1])) == len(set(hands[2])) == 1
    both = {*hands[1][0], *hands[2][0]}
    assert len(both) == 4  # people tremble each for themselves
    assert all(hand.count("seed=") == 1 for hand in both)
    assert ideal_settings(base, 2).users == session_settings(base, "coupling", CLEAN, 2).users
    reach = session_settings(msgspec.to_builtins(resolve(TWO)), "wave", "lan", 9).users[1]
    assert reach.hand == TWO["users"][1]["hand"]
    base = msgspec.to_builtins(resolve({**TWO, "users": [{"name": "a", "hand": "tremor&seed=3.0"}]}))  # with a point
    assert session_settings(base, "wave", CLEAN, 1).users[0].hand == f"tremor&seed={(3 * 65_536 + 1) * 256}"


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("wavs", "did you mean wave"),
        ("zzzz", f"there are: {', '.join(METHODS)}"),
        ("", "there is no method"),
    ],
)
def test_unknown_names(asked: str, words: str) -> None:
    with pytest.raises(ChoiceError, match=words):
        choose("method", [asked], tuple(METHODS))
    with pytest.raises(ChoiceError, match="no method is named"):
        choose("method", [], tuple(METHODS))
    assert choose("method", ["wave", "wave"], tuple(METHODS)) == ("wave",)


@pytest.mark.parametrize(
    ("change", "seeds", "words"),
    [
        ({"seconds": 1.9}, 1, "too short.* at least 2"),
        ({"users": [{"name": "a", "device": "emulated:vintage"}]}, 1, "a: emulated:vintage: the same hand is held"),
        ({}, 0, "at least 1"),
        ({}, 100_001, "more than 100000"),
    ],
)
def test_what_cannot_be_compared(change: dict[str, Any], seeds: int, words: str) -> None:
    with pytest.raises(ChoiceError, match=words):
        prepare(resolve({**TWO, **change}), ["wave"], ["lan"], seeds)


@pytest.mark.parametrize(("rates_hz", "common_hz"), [((2048, 2048), 2048), ((1024, 1536), 512), ((None, 1536), 512)])
def test_the_ideal_is_at_a_rate_that_everybody_has(rates_hz: tuple[int | None, int], common_hz: int) -> None:
    base = msgspec.to_builtins(resolve({**TWO, "rates": {"device_hz": 1024}}))
    for user, rate_hz in zip(base["users"], rates_hz, strict=True):
        user["device_hz"] = rate_hz
    ideal = ideal_settings(base, 1)
    assert ideal.rates.network_hz == common_hz
    assert [rates_of(ideal, user).device_hz for user in ideal.users] == [rate_hz or 1024 for rate_hz in rates_hz]


def test_every_case_is_named_once_and_clean_comes_first() -> None:
    asked = prepare(resolve({**TWO, "seed": 7}), ["wave", "coupling"], list(NETWORKS), 3)
    values = [asked.values(case) for case in range(asked.cases)]
    assert len({tuple(each.values()) for each in values}) == asked.cases == 2 * 6 * 3
    assert {each["seed"] for each in values} == {7, 8, 9}
    jobs = asked.jobs({0: Result(0, {})})
    assert [job.case for job in jobs] == list(range(1, asked.cases))
    chunks = [values[start : start + asked.batch] for start in range(0, asked.cases, asked.batch)]
    for chunk in chunks:
        assert chunk[0]["network"] == CLEAN
        assert len({(each["method"], each["seed"]) for each in chunk}) == 1


# Felt stiffness


@pytest.mark.parametrize(("compensate", "frames"), every(6, product((False, True), (1, 0, 3))))
def test_waves_feel_as_theory_says(compensate: bool, frames: int) -> None:
    """Check 1 / K_felt = 1 / K + (T_fwd + T_back + T_n) / (2 b) (theory section 4), to 0.5 %.

    The same line adds the same softness to unlike springs; by what it was asked for, the stiffer one is further off.
    """
    springs_npm = (200.0, 300.0) if compensate else (200.0, 4000.0)
    users = [{"name": f"{npm:g}", "stiffness_npm": npm} for npm in springs_npm]
    link, coupling = {"delay_ms": frames * FRAME_MS}, {"compensate": compensate}
    line = 0.0 if compensate else (2 * frames + 1) / 128 / 40.0
    everybody = measure_felt(resolve({**TWO, "link": link, "coupling": coupling, "users": users}))
    for felt, asked in zip(everybody, springs_npm, strict=True):
        assert (felt.person, felt.asked_npm) == (f"{asked:g}", asked)
        assert felt.felt_npm == pytest.approx(1.0 / (1.0 / asked + line), rel=5e-3)
        assert felt.added_mm_per_n == pytest.approx(1e3 * line, abs=5.0 / asked if compensate else 3e-3)
        assert felt.error_percent == pytest.approx(100.0 * (1.0 / (1.0 + asked * line) - 1.0), abs=0.5)


def test_the_person_furthest_off() -> None:
    near, far, none = (
        ProbedStiffness("near", 5000.0, 4500.0),
        ProbedStiffness("far", 100.0, 80.0),
        ProbedStiffness("none", 100.0, None),
    )
    assert (near.error_percent, far.error_percent) == (pytest.approx(-10.0), pytest.approx(-20.0))
    assert far.added_mm_per_n == pytest.approx(2.5)
    assert none.error_percent is None
    assert none.added_mm_per_n is None
    assert furthest_off([near, far]) == furthest_off([far, near]) == far  # though 500 N/m are more than 20
    assert furthest_off([near, none, far]) == none
    assert furthest_off([]) is None


def test_virtual_coupling_feels_its_spring_and_nothing_where_it_never_rests() -> None:
    table = {**TWO, "coupling": {"kind": "coupling", "stiffness_npm": 800.0}, "users": [{"name": n} for n in "ab"]}
    for felt in measure_felt(resolve(table)):
        assert felt.felt_npm == pytest.approx(800.0, rel=1e-3)
    shaking = {**table, "coupling": {"kind": "coupling", "stiffness_npm": 20_000.0}, "link": {"delay_ms": 20.0}}
    assert [felt.felt_npm for felt in measure_felt(resolve(shaking))] == [None] * 2
    assert measure_felt(resolve({**TWO, "users": [{"name": "alone"}]})) == ()


@pytest.mark.parametrize(
    ("kind", "sides", "loads"),
    [
        ("cube", "ll", [1.0, -1.0]),
        ("cube", "lll", [1.0, -2.0, 1.0]),
        ("cube", "l", None),
        ("faces", "lr", [1.0, -1.0]),
        ("faces", "rl", [-1.0, 1.0]),
        ("faces", "ll", None),
        ("wall", "lr", [1.0, -1.0]),
        ("wall", "l", [1.0]),
    ],
)
def test_loads_are_balanced_or_there_are_none(kind: str, sides: str, loads: list[float] | None) -> None:
    users = [{"name": str(n), "side": {"l": "left", "r": "right"}[side]} for n, side in enumerate(sides)]
    found = balanced_loads(resolve({"object": {"kind": kind}, "users": users}))
    assert found == (None if loads is None else [LOAD_N * load for load in loads])


# Sessions


def free(method: str, stiffness: float, frames: int) -> Any:
    """Run two free ideal devices of theory section 6 for three seconds; 0.3 N each, apart, one a little after the other."""
    users = [
        {"name": name, "device": "sim:ideal", "hand": FREE.format(force, start), "device_mass_kg": 0.1}
        for name, force, start in (("a", 0.3, 0.2), ("b", -0.3, 0.21))
    ]
    settings = resolve({
        "seconds": 3.0, "link": {"delay_ms": frames * FRAME_MS}, "coupling": {"stiffness_npm": stiffness},
        "object": {"mass_kg": 0.2}, "users": users,
    })  # fmt: skip
    return run_session(session_settings(msgspec.to_builtins(settings), method, OWN, 1), 2.0)


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("method", "stiffness", "frames", "fails"),
    [
        long("coupling", 1000.0, 0, True),  # 1.2005
        ("coupling", 1000.0, 1, False),  # 1.0000
        ("coupling", 2000.0, 1, True),  # 1.2289
        long("paper", 100.0, 1, False),  # 1.0000
        ("paper", 2000.0, 1, True),  # 1.2554
        long("wave", 2000.0, 1, False),
        ("wave", 100_000.0, 4, False),
    ],
)
def test_methods_fail_where_theory_says_and_nowhere_else(
    method: str, stiffness: float, frames: int, fails: bool
) -> None:
    """Run theory section 6's table as whole sessions: so a comparison can fail, and ours does not."""
    session = free(method, stiffness, frames)
    created_mj = 1e3 * created_j(session.trace.work_j, session.trace.object_j)
    assert (created_mj > SWING_MJ) == fails
    late_mj = 1e3 * created_at_rest_j(session.trace)
    oscillates = is_oscillating(at_rest(session.trace)[1], late_mj)  # the motors' limit keeps some from going further
    assert (bool(session.diverged) or oscillates) == fails
    if method == "wave":
        assert session.summary["passive"]
        leaks = [user["energy"]["device_leak_j"] for user in session.summary["users"]]
        assert created_mj <= -1e3 * sum(leaks) + 1e-9  # lines and object made none: what there is, sampled dampers leak


def test_a_clean_link_has_no_error_to_itself_and_one_view(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(felt_module, "SETTLE_S", 0.5)
    monkeypatch.setattr(felt_module, "LAST_S", 0.5)
    asked = small(networks=["wan"], seeds=1)
    by = {(job.method, job.network): run_case(measure_case, job).measures for job in asked.jobs({})}
    for method in asked.methods:
        clean, wan = by[method, CLEAN], by[method, "wan"]
        assert clean["error_clean_n"] == 0.0
        assert clean["coherence_max_mm"] < 1e-9
        assert wan["error_clean_n"] > 0.01
        assert wan["coherence_max_mm"] > wan["coherence_rms_mm"] > 0.0
        assert set(clean) == {*COLUMNS, "felt", "trace"}
    assert by["coupling", CLEAN]["error_ideal_n"] < by["coupling", "wan"]["error_ideal_n"]
    assert by["coupling", CLEAN]["felt_error_percent"] == pytest.approx(0.0, abs=0.1)
    for measures in by.values():
        errors = [person["error_percent"] for person in measures["felt"]]
        names = [person["person"] for person in measures["felt"]]
        assert names == ["a", "b"]
        if None not in errors:
            assert measures["felt_error_percent"] == max(errors, key=abs)
            assert measures["felt_person"] == names[errors.index(max(errors, key=abs))]


@pytest.mark.sample(1)
@pytest.mark.parametrize("method", HELD)
def test_views_do_not_depend_on_where_hands_begin(method: str) -> None:
    """Some servers answer in each person's own frame, some in the object's."""
    views = []
    for begins in ((0.0, 0.0), (0.01, -0.02)):
        users = [
            {"name": name, "device": f"sim:ideal?x0_m={x0}", "hand": f"reach&amplitude_m=0.02&delay_s={delay}"}
            for name, x0, delay in (("a", begins[0], 0.1), ("b", begins[1], 0.3))
        ]
        base = msgspec.to_builtins(resolve({"seconds": 1.0, "rates": {"device_hz": 512}, "users": users}))
        trace = run_session(session_settings(base, method, CLEAN, 1), 0.8).trace
        assert np.abs(trace.position_m[0]).max() < 1e-3
        assert np.abs(trace.view_m).max() > 5e-3
        assert furthest(trace.view_m)[1] < 1e-12
        views.append(trace.view_m)
    assert np.abs(views[0] - views[1]).max() < 1e-9
