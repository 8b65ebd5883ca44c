"""Effects that a client renders: laws against their potentials, the energy tank, amplitudes at the device, limits."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cogrip.client.effects.active import MOST_TURN, Grating, Vibration
from cogrip.client.effects.effect_force import LAWS, EffectForce
from cogrip.client.effects.laws import Moment, PassiveLaw
from cogrip.client.effects.tank import EnergyTank
from cogrip.client.hand.frame import HandFrame
from cogrip.client.sources.force_source import AtHand, ForceSources
from cogrip.devices.device import Capability
from cogrip.protocol.settings.effects import MOST_EFFECTS, Effect, unfit_effect
from cogrip.protocol.wire.messages import Effects

from tests.client.seated_client import capability

TICK_S = 1.0 / 1024.0
X = (1.0, 0.0, 0.0)
CARRIED = (50.0, 1e5)
STILL = (0.0, 0.0, 0.0)
WALL = Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=500.0)


def vibration(amplitude_n: float, frequency_hz: float, **more: Any) -> Effect:
    return Effect("vibration", direction=X, amplitude_n=amplitude_n, frequency_hz=frequency_hz, **more)


def constant(force_n: float, **more: Any) -> Effect:
    return Effect("constant", direction=X, force_n=force_n, **more)


def perturbation(amplitude_n: float, seconds: float, **more: Any) -> Effect:
    return Effect("perturbation", direction=X, amplitude_n=amplitude_n, seconds=seconds, **more)


def curl(damping_nspm: float, z: float = 1.0) -> Effect:
    return Effect("curl", direction=(0.0, 0.0, z), damping_nspm=damping_nspm)


def texture(amplitude_n: float, period_m: float) -> Effect:
    return Effect("texture", direction=X, amplitude_n=amplitude_n, period_m=period_m)


SPRINGS = (
    Effect("magnet", (0.001, -0.002, 0.0), radius_m=0.01, stiffness_npm=400.0),
    Effect("path", points_m=((-0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.0, 0.005)), stiffness_npm=300.0),
    Effect("path", points_m=((-0.01, 0.0, 0.0), (0.01, 0.0, 0.0)), stiffness_npm=300.0, force_n=1.0),
    Effect("zone", size_m=(0.005, 0.004, 0.0), stiffness_npm=500.0),
    Effect("zone", direction=(1.0, 2.0, -2.0), stiffness_npm=500.0),
    Effect("zone", direction=(0.0, 1.0, 0.0), stiffness_npm=500.0, force_n=1.0),
    Effect("spring", (0.001, -0.002, 0.0), stiffness_npm=200.0),
    Effect("spring", (0.001, -0.002, 0.0), stiffness_npm=400.0, force_n=2.0),
    Effect("channel", points_m=((-0.01, 0.0, 0.0), (0.01, 0.005, 0.0)), stiffness_npm=300.0),
)
places = st.lists(st.floats(-0.02, 0.02), min_size=3, max_size=3)


def at_hand(
    tick: int, place_m: tuple[float, ...], rate_mps: tuple[float, ...], gain: float = 1.0,
    carried: tuple[float, float] = CARRIED,
) -> AtHand:  # fmt: skip
    return AtHand(tick, place_m, rate_mps, HandFrame(), gain, *carried)


def passive(effect: Effect, places: int) -> PassiveLaw:
    law = LAWS[effect.kind](effect, places, TICK_S)
    assert isinstance(law, PassiveLaw)
    return law


def fit(effects: EffectForce, record: Capability) -> None:
    effects.fit(record, record, 1.0)


def force_of(*effects: Effect, axes: int = 1, tank_mj: float = 10.0, latency: int = 0) -> EffectForce:
    """Return the effects of a seat that has been told of these."""
    found = EffectForce(axes, TICK_S, 0.0)
    fit(found, capability(axes, latency=latency, speed_mps=1.0))
    numbers = tuple(range(1, len(effects) + 1))
    for number, each in enumerate(effects, 1):
        assert not found.tell(Effects(1, 1, numbers, tank_mj, number, each), 0)
    return found


def held(effects: EffectForce, ticks: int, place: Callable[[int], float] = lambda tick: 0.0) -> list[float]:
    """Move a hand of one axis. Returns the force of each tick, all of which its device applies."""
    before, force, forces = place(0), (0.0,), []
    for tick in range(ticks):
        now = place(tick)
        effects.enter(1, 1.0, (before,), (now,))
        asked = effects.force(at_hand(tick, (now,), ((now - before) / TICK_S,)))
        force = tuple(asked or (0.0,))
        forces.append(force[0])
        before = now
    return forces


def travelled(
    effects: EffectForce, way: Sequence[Sequence[float]], latency: int = 0
) -> tuple[list[tuple[float, ...]], float]:
    """Move a hand of several axes. Returns the force of each tick, and what the hand put in [J]."""
    before, force, forces, put_in_j = tuple(way[0]), (0.0,) * len(way[0]), list[tuple[float, ...]](), 0.0
    for tick, place in enumerate(map(tuple, way)):
        step = np.subtract(place, before)
        effects.enter(1, 1.0, before, place)
        put_in_j += float(np.dot(force, step))
        force = effects.force(at_hand(tick, place, tuple(step / TICK_S))) or force
        forces.append(force)
        before = place
    return forces, put_in_j


def steepest(forces: Sequence[float]) -> float:
    """Return the largest slope [N/s]."""
    return float(np.abs(np.diff(forces)).max()) / TICK_S


def rendered(
    effects: EffectForce, ticks: range, *place: float, speed: float = 0.0, carried: tuple[float, float] = CARRIED
) -> float:
    """Keep a hand at a place. Returns the last force along its last axis; 0 without one."""
    rate = (0.0,) * (len(place) - 1) + (speed,)
    force = [effects.force(at_hand(tick, place, rate, carried=carried)) for tick in ticks][-1]
    return force[-1] if force else 0.0


@pytest.mark.parametrize("effect", SPRINGS)
@given(at=places, to=places)
def test_spring_is_the_gradient_of_its_potential_and_no_stiffer_than_it_says(
    effect: Effect, at: list[float], to: list[float]
) -> None:
    law = passive(effect, 3)
    here, there = law.felt(at, STILL), law.felt(to, STILL)
    force = np.array(here.spring_n or STILL)
    step = np.subtract(to, at)
    # what one sampled tick makes at most: K d^2 / 2 (theory 7.8)
    assert there.stored_j <= here.stored_j + force @ step + 0.5 * law.stiffness_npm * step @ step + 1e-12
    assert here.stored_j >= 0.0
    near = law.felt((np.array(at) + 1e-7 * step).tolist(), STILL)
    # midway between two sides there is no gradient
    assume(np.abs(np.subtract(near.spring_n or STILL, force)).max() < 1e-3)
    slope = near.stored_j - here.stored_j
    assert slope == pytest.approx(1e-7 * float(force @ step), abs=1e-10)


def test_magnet_has_the_closed_form_of_its_potential() -> None:
    law = passive(SPRINGS[0], 3)
    radius, stiffness = 0.01, 400.0
    for share in (0.0, 0.3, 0.7, 0.999):
        felt = law.felt((0.001 + share * radius, -0.002, 0.0), STILL)
        left = 1.0 - share * share
        assert felt.spring_n[0] == pytest.approx(stiffness * share * radius * left * left, abs=1e-12)
        assert felt.stored_j == pytest.approx(stiffness * radius**2 / 6.0 * (1.0 - left**3), abs=1e-15)
    outside = law.felt((0.012, 0.0, 0.0), STILL)
    assert outside.spring_n == ()
    assert outside.stored_j == pytest.approx(stiffness * radius**2 / 6.0)
    bounded = passive(Effect("magnet", radius_m=0.01, stiffness_npm=4000.0, force_n=2.0), 1)
    forces = [bounded.felt((0.01 * share / 1000.0,), (0.0,)).spring_n for share in range(1000)]
    assert max(force[0] for force in forces) == pytest.approx(2.0, rel=1e-4)


def test_path_pulls_across_by_k_d_and_lets_go_along() -> None:
    law = passive(Effect("path", points_m=PATH, stiffness_npm=200.0, damping_nspm=2.0), 2)
    felt = law.felt((0.03, 0.004), (0.2, 0.1))
    assert list(felt.spring_n) == pytest.approx([0.0, 0.8])
    assert list(felt.damper_n) == pytest.approx([0.0, 0.2])


def test_channel_holds_the_hand_on_its_line_beyond_both_ends() -> None:
    law = passive(Effect("channel", points_m=PATH, stiffness_npm=200.0, damping_nspm=2.0), 2)
    for along in (-0.3, 0.03, 0.5):
        felt = law.felt((along, 0.004), (0.2, 0.1))
        assert list(felt.spring_n) == pytest.approx([0.0, 0.8])
        assert list(felt.damper_n) == pytest.approx([0.0, 0.2])
    ended = passive(Effect("path", points_m=PATH, stiffness_npm=200.0), 2)
    assert list(ended.felt((-0.3, 0.0), STILL).spring_n) == pytest.approx([-60.0, 0.0])


def test_spring_pulls_to_its_point_and_damps_every_motion() -> None:
    law = passive(Effect("spring", (0.01, 0.0, 0.0), stiffness_npm=200.0, damping_nspm=3.0, force_n=1.5), 2)
    near = law.felt((0.01, 0.005), (0.1, -0.2))
    assert list(near.spring_n) == pytest.approx([0.0, 1.0])
    assert list(near.damper_n) == pytest.approx([0.3, -0.6])
    assert list(law.felt((0.11, 0.0), STILL).spring_n) == pytest.approx([1.5, 0.0])


def test_zone_with_a_largest_force_is_a_load_that_costs_nothing_where_it_begins() -> None:
    """Behind its plane it pushes with F_m over any way, and gives back what the hand put in."""
    effects = force_of(Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=1000.0, force_n=2.0), tank_mj=0.0)
    out = np.linspace(-0.001, 0.1, 500)
    forces, put_in_j = travelled(effects, [(x,) for x in (*out, *out[::-1])])
    assert np.allclose([force for (force,) in forces[50:950]], 2.0)
    assert abs(put_in_j) <= 1000 * 0.5 * 1000.0 * (0.101 / 500) ** 2


def test_zone_only_pushes_out() -> None:
    law = passive(Effect("zone", direction=(-2.0, 0.0, 0.0), stiffness_npm=500.0, damping_nspm=4.0), 1)
    assert law.felt((-0.001,), (9.0,)).spring_n == ()
    pressed = law.felt((0.002,), (0.1,))
    assert pressed.spring_n[0] + pressed.damper_n[0] == pytest.approx(1.4)
    leaving = law.felt((0.002,), (-9.0,))
    assert leaving.spring_n[0] + leaving.damper_n[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("frequency_hz", [20.0, 50.0, 100.0, 150.0, 200.0])
def test_vibration_has_its_amplitude_at_the_device(frequency_hz: float) -> None:
    """The part at its frequency of the force as it is held over ticks, which the sinc of the hold has made smaller."""
    effect, fine = vibration(0.5, frequency_hz), 64
    steps = np.repeat(held(force_of(effect, tank_mj=1e3), 1024), fine)
    turned = np.exp(-2j * np.pi * frequency_hz * (np.arange(len(steps)) + 0.5) * TICK_S / fine)
    assert 2.0 * abs(np.mean(steps * turned)) == pytest.approx(0.5, rel=0.002)
    law = Vibration(effect, 1, TICK_S)
    forces = [law.force(Moment((0.0,), (0.0,), tick, 0.0))[0] for tick in range(1024)]
    assert steepest(forces) <= law.slope_nps * (1.0 + 1e-9)


@pytest.mark.parametrize(("amplitude_n", "many", "least"), [(2.0, 1, 0.0), (0.795, 16, 950.0)])
def test_vibrations_that_the_slope_limit_would_cut_are_smaller_together(
    amplitude_n: float, many: int, least: float
) -> None:
    """One alone, or 16 that each have just the largest slope."""
    effects = force_of(*[vibration(amplitude_n, 200.0)] * many, tank_mj=1e3)
    assert least <= steepest(held(effects, 1024)) <= 1000.0 * (1.0 + 1e-9)
    assert effects.reduced


@pytest.mark.parametrize("device_hz", [250, 256, 500, 512, 1024])
def test_vibration_faster_than_half_of_the_ticks_is_bounded(device_hz: int) -> None:
    """The sinc of the hold is 0 at the rate of the ticks."""
    assert Vibration(vibration(1.0, 256.0), 1, 1.0 / device_hz).most_n <= math.pi / 2.0


PATH = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
SMALLEST: list[tuple[Callable[[float], Effect], float]] = [
    (lambda x: Effect("zone", direction=(x, 0.0, 0.0), stiffness_npm=9.0), 1e-6),
    (lambda x: Effect("vibration", direction=(0.0, x, 0.0), amplitude_n=1.0, frequency_hz=50.0), 1e-6),
    (lambda x: Effect("texture", direction=(0.0, x, 0.0), amplitude_n=1.0, period_m=0.01), 1e-6),
    (lambda x: vibration(1.0, x), 1e-3),
    (lambda x: texture(1.0, x), 1e-4),
    (lambda x: Effect("magnet", radius_m=x, stiffness_npm=9.0), 1e-4),
    (lambda x: Effect("magnet", radius_m=x, stiffness_npm=9.0, force_n=1.0), 1e-4),
    (lambda x: Effect("path", points_m=((0.0, 0.0, 0.0), (x, 0.0, 0.0)), stiffness_npm=9.0), 1e-4),
    (lambda x: Effect("path", points_m=PATH, stiffness_npm=x, force_n=1.0), 5e-324),
    (lambda x: Effect("path", points_m=PATH, stiffness_npm=9.0, force_n=x), 5e-324),
    (lambda x: Effect("zone", size_m=(x, 0.0, 0.0), stiffness_npm=9.0), 5e-324),
    (lambda x: Effect("viscous", size_m=(x, 0.0, 0.0), damping_nspm=x), 5e-324),
    (lambda x: curl(3.0, x), 1e-6),
    (lambda x: curl(x, -1.0), 5e-324),
    (lambda x: constant(x), 5e-324),
    (lambda x: Effect("constant", direction=(0.0, x, 0.0), force_n=1.0), 1e-6),
    (lambda x: perturbation(1.0, x), 1e-2),
    (lambda x: Effect("spring", stiffness_npm=x, force_n=1.0), 5e-324),
    (lambda x: Effect("spring", stiffness_npm=9.0, force_n=x), 5e-324),
    (lambda x: Effect("channel", points_m=((0.0, 0.0, 0.0), (x, 0.0, 0.0)), stiffness_npm=9.0), 1e-4),
]


@pytest.mark.parametrize(("make", "least"), SMALLEST)
def test_numbers_next_to_zero_are_refused_or_give_a_finite_force(make: Callable[[float], Effect], least: float) -> None:
    assert unfit_effect(make(least), 2) == ""
    for size in (least, 5e-324, 1e-200, 1e-160):
        rig = EffectForce(2, TICK_S, 0.0)
        fit(rig, capability(2))
        fits = not unfit_effect(make(size), 2)
        assert fits is (size >= least)
        assert rig.tell(Effects(1, 1, (1,), 10.0, 1, make(size)), 0) == ("" if fits else "unfit effect")
        for tick in range(32):
            force = rig.force(at_hand(tick, (1e-3, 1e-3), (0.1, 0.1)))
            assert force is None or all(map(math.isfinite, force))


@given(law=st.floats(-20.0, 20.0), applied=st.floats(-20.0, 20.0))
def test_no_more_of_a_force_is_taken_for_effects_than_was_asked(law: float, applied: float) -> None:
    """law: of coupling and effects, which may cancel out while slope limits still hold a force."""
    effects = force_of(WALL)
    rendered(effects, range(64), -1e-3)
    sources = ForceSources(effects)
    asked = sources.added((0.0,), at_hand(64, (0.01,), (0.0,)))
    sources.wish_n = (law,)
    sources.enter(1, (applied,), (applied,), (0.01,), (0.01,))
    assert all(0.0 <= own <= all_of for own, all_of in zip(effects.acted_n, asked, strict=True))


def test_viscous_field_has_its_coefficient() -> None:
    forces = held(
        force_of(Effect("viscous", size_m=(0.05, 0.0, 0.0), damping_nspm=5.0)), 461, lambda n: 0.1 * n * TICK_S
    )
    assert np.allclose(forces[52:], 0.5, rtol=0.01), "between 5 and 45 mm"


@pytest.mark.parametrize(("carried", "expected"), [((50.0, 1e5), 8.0), ((22.0, 1e5), 2.0), ((20.0, 1e5), 0.0)])
def test_dampers_get_what_the_coupling_leaves_of_the_device(carried: tuple[float, float], expected: float) -> None:
    effects = EffectForce(1, TICK_S, 20.0)
    fit(effects, capability())
    effects.tell(Effects(1, 1, (1,), 1.0, 1, Effect("viscous", damping_nspm=8.0)), 0)
    assert rendered(effects, range(64), 0.0, speed=1.0, carried=carried) == pytest.approx(expected)
    assert effects.reduced is (expected < 8.0)


def test_springs_are_no_stiffer_than_the_device_carries() -> None:
    effects = force_of(replace(WALL, stiffness_npm=4000.0))
    rendered(effects, range(64), -0.001, carried=(50.0, 1000.0))
    assert rendered(effects, range(64, 128), 0.001, carried=(50.0, 1000.0)) == pytest.approx(1.0)


def test_texture_is_no_stiffer_than_the_device_carries_and_draws_from_the_tank() -> None:
    effect = texture(1.0, 0.002)
    assert Grating(effect, 1, TICK_S).stiffness_npm == pytest.approx(1000.0 * math.pi)
    effects, carried = force_of(effect, tank_mj=5.0), (50.0, 500.0 * math.pi)
    peak = max(rendered(effects, range(tick, tick + 1), 0.0005, carried=carried) for tick in range(64))
    assert peak == pytest.approx(0.5)


def test_fixture_around_a_hand_comes_as_far_as_the_tank_pays() -> None:
    """A path 20 mm from the hand stores 40 mJ; the tank has 10 mJ, so a quarter of it is rendered, and nothing is given."""
    effects = force_of(Effect("path", points_m=PATH, stiffness_npm=200.0), axes=2)
    assert rendered(effects, range(256), 0.05, 0.02) == pytest.approx(0.25 * 4.0)
    assert effects.held_j == pytest.approx(0.01)
    assert effects.tank.level_j == pytest.approx(0.0, abs=1e-12)
    rendered(effects, range(256, 300), 0.05, 0.0)  # there it costs nothing
    assert rendered(effects, range(300, 301), 0.05, 0.005) == pytest.approx(1.0)


def circle(ticks: int, turns_hz: float, speed_mps: float) -> list[tuple[float, float]]:
    angles = 2.0 * math.pi * turns_hz * TICK_S * np.arange(ticks)
    radius = speed_mps / (2.0 * math.pi * abs(turns_hz))
    return [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]


@pytest.mark.parametrize(("z", "expected"), [(1.0, (0.8, -0.4)), (-3.0, (-0.8, 0.4))])
def test_curl_field_pushes_across_the_motion(z: float, expected: tuple[float, float]) -> None:
    """On the hand F = B v x n, which is B [[0, 1], [-1, 0]] v for n = z."""
    effects = force_of(curl(4.0, z), axes=2)
    for tick in range(64):
        force = effects.force(at_hand(tick, (0.0, 0.0), (0.1, 0.2)))
    assert force == pytest.approx((-expected[0], -expected[1]))
    spatial = force_of(Effect("curl", direction=(0.0, 2.0, 0.0), damping_nspm=4.0), axes=3)
    for tick in range(64):
        force = spatial.force(at_hand(tick, (0.0, 0.0, 0.0), (0.1, 0.2, 0.3)))
    assert force == pytest.approx((4.0 * 0.3, 0.0, -4.0 * 0.1))


@pytest.mark.parametrize("turns_hz", [1.0, -1.0])
def test_curl_field_gives_what_its_lag_turns_of_it_and_takes_it_back(turns_hz: float) -> None:
    """On a circle of angular rate w a lag of t gives B v^2 sin(w t) or takes it: here one tick, of the displacement."""
    effects, speed = force_of(curl(5.0), axes=2, tank_mj=100.0), 0.2
    _, first_j = travelled(effects, circle(200, turns_hz, speed))
    lag = math.sin(2.0 * math.pi * turns_hz * TICK_S)
    assert first_j == pytest.approx(5.0 * speed**2 * lag * 200 * TICK_S, rel=0.1)
    small = force_of(curl(5.0), axes=2, tank_mj=3.0)
    forces, put_in_j = travelled(small, circle(8192, turns_hz, speed))
    left = max(0.0, -math.tan(2.0 * math.pi * turns_hz * TICK_S) / MOST_TURN)
    assert small.tank.missing == pytest.approx(left, rel=0.02, abs=1e-6)
    assert put_in_j >= -3e-3 * small.tank.missing * (1.0 + 1e-9)
    sizes = np.hypot(*np.array(forces[64:]).T)
    assert sizes.min() == pytest.approx(1.0, rel=1e-3), "B v, for ever"


def test_curl_field_counts_among_the_dampers_that_a_device_carries() -> None:
    effects = force_of(curl(6.0), Effect("viscous", damping_nspm=2.0), axes=2)
    for tick in range(64):
        force = effects.force(at_hand(tick, (0.0, 0.0), (0.0, 1.0), carried=(4.0, 1e5)))
    assert force == pytest.approx((-3.0, 1.0))
    assert effects.reduced
    assert effects.local_n == pytest.approx(force), "the detector of oscillation sees all of it"
    assert effects.account().reduced_s == pytest.approx(64 * TICK_S)  # type: ignore[union-attr]


def test_constant_force_holds_against_the_hand_and_gives_way_as_the_tank_does() -> None:
    effects = force_of(constant(2.0))
    forces, put_in_j = travelled(effects, [(-1e-4 * tick,) for tick in range(600)])
    assert np.allclose([force for (force,) in forces[21:]], -2.0), "it pushes towards +x, and rose in 20 ms"
    assert put_in_j > 0.1
    forces, put_in_j = travelled(effects, [(-0.06 + 1e-4 * tick,) for tick in range(600)])
    assert -0.01 <= put_in_j <= -0.0099, "10 mJ, and no more"
    way_m = 1e-4 * next(tick for tick, (force,) in enumerate(forces) if force > -1.9)
    assert way_m == pytest.approx((0.01 - 2.0 * TICK_S) / 2.0, abs=2e-4), "(E - F v_m T) / F"
    assert effects.account().reduced_s > 0.0  # type: ignore[union-attr]
    forces, _ = travelled(force_of(constant(2.0, size_m=(0.01, 0.0, 0.0))), [(0.02,)] * 64)
    assert not any(force for (force,) in forces)


def test_perturbation_is_half_a_sine_of_its_time() -> None:
    forces = held(force_of(perturbation(1.5, 0.1), tank_mj=100.0), 256)
    assert min(forces) == pytest.approx(-1.5, rel=1e-3)
    assert -sum(forces) * TICK_S == pytest.approx(2.0 * 1.5 * 102 * TICK_S / math.pi, rel=1e-3)
    assert not any(forces[104:])
    assert steepest(forces) <= math.pi * 1.5 / (102 * TICK_S) * (1.0 + 1e-9)


def test_perturbation_with_a_box_begins_once_as_the_hand_comes_into_it() -> None:
    effects = force_of(perturbation(1.0, 0.05, place_m=(0.03, 0.0, 0.0), size_m=(0.01, 0.0, 0.0)), tank_mj=100.0)
    forces = held(effects, 1024, lambda tick: 0.04 * math.sin(2.0 * math.pi * tick / 512))
    felt = [tick for tick, force in enumerate(forces) if force]
    into = 512 * math.asin(0.5) / (2.0 * math.pi)
    assert felt[0] == pytest.approx(into + 1.0, abs=1.0)
    assert felt[-1] - felt[0] == pytest.approx(0.05 / TICK_S, abs=3.0)


newtons, stiffnesses, metres = st.floats(0.1, 40.0), st.floats(1.0, 5e3), st.floats(0.0, 0.01)
ACTIVE = st.one_of(
    st.builds(vibration, newtons, st.floats(1.0, 250.0)),
    st.builds(texture, newtons, st.floats(1e-4, 0.1)),
    st.builds(lambda force, half: constant(force, size_m=(half, 0.0, 0.0)), newtons, metres),
    st.builds(lambda size, s, half: perturbation(size, s, size_m=(half, 0.0, 0.0)), newtons, st.floats(0.01, 0.1), metres),
    st.builds(curl, newtons, st.sampled_from((-1.0, 1.0))),
)  # fmt: skip
PASSIVE_ONES = st.one_of(
    st.builds(lambda b, h: Effect("viscous", size_m=(h, 0.0, 0.0), damping_nspm=b), newtons, metres),
    st.builds(lambda k, r: Effect("magnet", stiffness_npm=k, radius_m=r), stiffnesses, st.floats(1e-3, 0.05)),
    st.builds(lambda k: Effect("zone", size_m=(0.004, 0.0, 0.0), stiffness_npm=k), stiffnesses),
    st.builds(lambda k, f: Effect("spring", (0.003, 0.001, 0.0), stiffness_npm=k, force_n=f), stiffnesses, newtons),
    st.builds(lambda k: Effect("channel", points_m=PATH, stiffness_npm=k), stiffnesses),
)
Steps = list[tuple[float, float, float]]
turns = st.sampled_from((0.0, 0.25)) | st.floats(0.0, 1.0)


@settings(max_examples=1000)
@given(
    effects=st.lists(ACTIVE, min_size=1, max_size=3),
    more=st.lists(PASSIVE_ONES, max_size=2),
    steps=st.lists(st.tuples(st.floats(-1.0, 1.0), turns, st.floats(0.0, 1.0)), min_size=1, max_size=40),
    tank_mj=st.floats(0.01, 20.0),
    latency=st.integers(0, 3),
)
@example([vibration(1.0, 76.0)], [], [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0)], 0.5, 1)
@example(
    [vibration(1.0, 1.0)],
    [Effect("zone", size_m=(0.004, 0.0, 0.0), stiffness_npm=160.0)],
    [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)],
    0.0625,
    2,
)
def test_tank_is_never_overdrawn(
    effects: list[Effect], more: list[Effect], steps: Steps, tank_mj: float, latency: int
) -> None:
    """Whatever the hand does within the device's speed limit, and however the gain of safety falls and rises."""
    rig = force_of(*effects, *more, axes=2, tank_mj=tank_mj, latency=latency)
    sources = ForceSources(rig)
    place, force, given_j = (0.0, 0.0), (0.0, 0.0), 0.0
    active = [(0.0, 0.0)] * (latency + 1)
    for tick, (speed, turn, gain) in enumerate(steps):
        rate = speed * math.cos(2.0 * math.pi * turn), speed * math.sin(2.0 * math.pi * turn)
        before, place = place, (place[0] + rate[0] * TICK_S, place[1] + rate[1] * TICK_S)
        sources.enter(1, force, force, before, place)
        given_j -= sum(a * v * TICK_S for a, v in zip(active[tick], rate, strict=True))
        sources.wish_n = wish_n = sources.added((0.0, 0.0), at_hand(tick, place, rate, gain))
        force = (gain * wish_n[0], gain * wish_n[1])
        acting = rig._held[1] or (0.0, 0.0)
        active.append((gain * acting[0], gain * acting[1]))
        assert rig.tank.overdrawn_j <= 1e-15
        assert 0.0 <= rig.tank.least_j <= rig.tank.level_j <= rig.tank.capacity_j
        if not more:
            assert given_j <= 1e-3 * tank_mj * (1.0 + 1e-9)


def test_tank_counts_what_a_late_tick_draws() -> None:
    tank = EnergyTank()
    tank.set_capacity(1e-3)
    tank.worked(-3e-3)
    assert (tank.level_j, tank.drawn_j, tank.overdrawn_j) == (0.0, 3e-3, 2e-3)
    tank.damped(-1e-3)  # a damper that is late gives something back
    assert tank.level_j == 0.0
    tank.damped(1.5e-3)
    assert tank.level_j == pytest.approx(0.5e-3)
    tank.damped(1.0)
    assert tank.level_j == 1e-3


def test_effects_are_taken_once_and_end_as_told() -> None:
    rig = force_of()
    assert rig.tell(Effects(1, 1, (1, 2), 1.0, 1, WALL), 0) == ""
    assert rig.known((1, 2)) == (1,)
    assert rig.tell(Effects(1, 1, (1, 2), 1.0, 2, Effect("viscous")), 0) == "unfit effect"  # without a damper
    assert rig.known((1, 2)) == (1, 2)  # it is not told again
    assert rig.tell(Effects(1, 0, (), 1.0), 0) == "late effects"
    assert rig.force(at_hand(1, (-0.001,), (0.0,))) is not None
    assert rig.tell(Effects(1, 2, (), 1.0), 1) == ""
    rendered(rig, range(2, 63), -0.001)
    assert rig.force(at_hand(63, (-0.001,), (0.0,))) is None
    for number in range(3, 100):
        rig.tell(Effects(1, 2 + number, (number,), 1.0, number, WALL), 64)
    assert len(rig._entries) <= 2 * MOST_EFFECTS


def test_effects_of_a_hand_without_force_make_room_for_others() -> None:
    """A world that goes on while a fault is latched: what it tells last is there once the hand is armed again."""
    rig = force_of()
    for number in range(1, 100):
        assert rig.tell(Effects(1, number, (number,), 1.0, number, WALL), number) == ""
        rig.begin_anew()
    assert list(rig._entries) == [99]


def test_burst_ends_by_itself() -> None:
    forces = held(force_of(vibration(0.5, 100.0, seconds=0.1)), 512)
    assert max(map(abs, forces[60:100])) > 0.4
    assert not any(forces[140:])
