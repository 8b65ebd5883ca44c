"""Effects that a client renders: laws against their potentials, the energy tank, amplitudes at the device, limits."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from cogrip.client.effects.active import Texture, Vibration
from cogrip.client.effects.force import PASSIVE, EffectForce
from cogrip.client.effects.tank import EnergyTank
from cogrip.protocol.effects import MOST_EFFECTS, Effect, unfit_effect
from cogrip.protocol.messages import Effects

from tests.client.seated_client import capability

TICK_S = 1.0 / 1024.0
X = (1.0, 0.0, 0.0)
CARRIED = (50.0, 1e5)
SPRINGS = (
    Effect("magnet", (0.001, -0.002, 0.0), radius_m=0.01, stiffness_npm=400.0),
    Effect("path", points_m=((-0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.01, 0.0, 0.005)), stiffness_npm=300.0),
    Effect("path", points_m=((-0.01, 0.0, 0.0), (0.01, 0.0, 0.0)), stiffness_npm=300.0, force_n=1.0),
    Effect("zone", size_m=(0.005, 0.004, 0.0), stiffness_npm=500.0),
    Effect("zone", direction=(1.0, 2.0, -2.0), stiffness_npm=500.0),
)
places = st.lists(st.floats(-0.02, 0.02), min_size=3, max_size=3)


def force_of(
    effect: Effect, *more: Effect, axes: int = 1, tank_mj: float = 10.0, speed_mps: float = 1.0
) -> EffectForce:
    """Return the effects of a seat that has been told of these."""
    found = EffectForce(axes, TICK_S, 0.0)
    found.fit(capability(axes, speed_mps=speed_mps), 1.0)
    effects = (effect, *more)
    numbers = tuple(range(1, len(effects) + 1))
    for number, each in enumerate(effects, 1):
        assert not found.tell(Effects(1, 1, numbers, tank_mj, number, each), 0)
    return found


def held(effects: EffectForce, ticks: int, place: Callable[[int], float]) -> Iterator[tuple[float, float]]:
    """Move a hand of one axis, and yield place and force of each tick, all of which its device applies."""
    before, force = place(0), (0.0,)
    for tick in range(ticks):
        now = place(tick)
        effects.enter(1, force, force, (before,), (now,))
        asked = effects.step(tick, (now,), ((now - before) / TICK_S,), 1.0, CARRIED)
        force = tuple(asked or (0.0,))
        effects._law = force
        yield now, force[0]
        before = now


@pytest.mark.parametrize("effect", SPRINGS)
@given(at=places, to=places)
def test_spring_is_the_gradient_of_its_potential_and_no_stiffer_than_it_says(
    effect: Effect, at: list[float], to: list[float]
) -> None:
    law, still = PASSIVE[effect.kind](effect, 3), (0.0, 0.0, 0.0)
    here, there = law.felt(at, still), law.felt(to, still)
    force = np.array(here.spring_n or still)
    step = np.subtract(to, at)
    # what one sampled tick makes at most: K d^2 / 2 (theory 7.8)
    assert there.stored_j <= here.stored_j + force @ step + 0.5 * law.stiffness_npm * step @ step + 1e-12
    assert here.stored_j >= 0.0
    near = law.felt((np.array(at) + 1e-7 * step).tolist(), still)
    assume(
        np.abs(np.subtract(near.spring_n or still, force)).max() < 1e-3
    )  # midway between two sides there is no gradient
    slope = near.stored_j - here.stored_j
    assert slope == pytest.approx(1e-7 * float(force @ step), abs=1e-10)


def test_magnet_has_the_closed_form_of_its_potential() -> None:
    law = PASSIVE["magnet"](SPRINGS[0], 3)
    radius, stiffness = 0.01, 400.0
    for share in (0.0, 0.3, 0.7, 0.999):
        felt = law.felt((0.001 + share * radius, -0.002, 0.0), (0.0, 0.0, 0.0))
        left = 1.0 - share * share
        assert felt.spring_n[0] == pytest.approx(stiffness * share * radius * left * left, abs=1e-12)
        assert felt.stored_j == pytest.approx(stiffness * radius**2 / 6.0 * (1.0 - left**3), abs=1e-15)
    outside = law.felt((0.012, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert outside.spring_n == ()
    assert outside.stored_j == pytest.approx(stiffness * radius**2 / 6.0)
    bounded = PASSIVE["magnet"](Effect("magnet", radius_m=0.01, stiffness_npm=4000.0, force_n=2.0), 1)
    forces = [bounded.felt((0.01 * share / 1000.0,), (0.0,)).spring_n for share in range(1000)]
    assert max(force[0] for force in forces) == pytest.approx(2.0, rel=1e-4)


def test_path_pulls_across_by_k_d_and_lets_go_along() -> None:
    law = PASSIVE["path"](
        Effect("path", points_m=((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), stiffness_npm=200.0, damping_nspm=2.0), 2
    )
    felt = law.felt((0.03, 0.004), (0.2, 0.1))
    assert list(felt.spring_n) == pytest.approx([0.0, 0.8])
    assert list(felt.damper_n) == pytest.approx([0.0, 0.2])


def test_zone_only_pushes_out() -> None:
    law = PASSIVE["zone"](Effect("zone", direction=(-2.0, 0.0, 0.0), stiffness_npm=500.0, damping_nspm=4.0), 1)
    assert law.felt((-0.001,), (9.0,)).spring_n == ()
    pressed = law.felt((0.002,), (0.1,))
    assert pressed.spring_n[0] + pressed.damper_n[0] == pytest.approx(1.4)
    leaving = law.felt((0.002,), (-9.0,))
    assert leaving.spring_n[0] + leaving.damper_n[0] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize("frequency_hz", [20.0, 50.0, 100.0, 150.0, 200.0])
def test_vibration_has_its_amplitude_at_the_device(frequency_hz: float) -> None:
    """The part at its frequency of the force as it is held over ticks, which the sinc of the hold has made smaller."""
    effects = force_of(
        Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=0.5, frequency_hz=frequency_hz), tank_mj=1e3
    )
    fine = 64
    steps = np.repeat([force for _, force in held(effects, 1024, lambda tick: 0.0)], fine)
    turned = np.exp(-2j * np.pi * frequency_hz * (np.arange(len(steps)) + 0.5) * TICK_S / fine)
    assert 2.0 * abs(np.mean(steps * turned)) == pytest.approx(0.5, rel=0.002)
    law = Vibration(
        Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=0.5, frequency_hz=frequency_hz), 1, TICK_S
    )
    steep = np.abs(np.diff([law.force((0.0,), tick)[0] for tick in range(1024)])).max() / TICK_S
    assert steep <= law.slope_nps * (1.0 + 1e-9)


def test_vibration_that_the_slope_limit_would_cut_is_smaller_and_still_a_sine() -> None:
    effect = Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=2.0, frequency_hz=200.0)
    effects = force_of(effect, tank_mj=1e3)
    forces = [force for _, force in held(effects, 1024, lambda tick: 0.0)]
    assert np.abs(np.diff(forces)).max() / TICK_S <= 1000.0 * (1.0 + 1e-9)
    assert effects.reduced


def test_vibrations_that_the_slope_limit_would_cut_together_are_smaller_together() -> None:
    """Each alone has just the largest slope."""
    effects = force_of(*[Effect("vibration", direction=X, amplitude_n=0.795, frequency_hz=200.0)] * 16, tank_mj=1e3)
    forces = [force for _, force in held(effects, 1024, lambda tick: 0.0)]
    assert np.abs(np.diff(forces)).max() / TICK_S == pytest.approx(1000.0, rel=0.05)
    assert np.abs(np.diff(forces)).max() / TICK_S <= 1000.0 * (1.0 + 1e-9)
    assert effects.reduced


@pytest.mark.parametrize("device_hz", [250, 256, 500, 512, 1024])
def test_vibration_faster_than_half_of_the_ticks_is_bounded(device_hz: int) -> None:
    """The sinc of the hold is 0 at the rate of the ticks."""
    law = Vibration(Effect("vibration", direction=X, amplitude_n=1.0, frequency_hz=256.0), 1, 1.0 / device_hz)
    assert law.most_n <= math.pi / 2.0


PATH = ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
SMALLEST: list[tuple[Callable[[float], Effect], float]] = [
    (lambda x: Effect("zone", direction=(x, 0.0, 0.0), stiffness_npm=9.0), 1e-6),
    (lambda x: Effect("vibration", direction=(0.0, x, 0.0), amplitude_n=1.0, frequency_hz=50.0), 1e-6),
    (lambda x: Effect("texture", direction=(0.0, x, 0.0), amplitude_n=1.0, period_m=0.01), 1e-6),
    (lambda x: Effect("vibration", direction=X, amplitude_n=1.0, frequency_hz=x), 1e-3),
    (lambda x: Effect("texture", direction=X, amplitude_n=1.0, period_m=x), 1e-4),
    (lambda x: Effect("magnet", radius_m=x, stiffness_npm=9.0), 1e-4),
    (lambda x: Effect("magnet", radius_m=x, stiffness_npm=9.0, force_n=1.0), 1e-4),
    (lambda x: Effect("path", points_m=((0.0, 0.0, 0.0), (x, 0.0, 0.0)), stiffness_npm=9.0), 1e-4),
    (lambda x: Effect("path", points_m=PATH, stiffness_npm=x, force_n=1.0), 5e-324),
    (lambda x: Effect("path", points_m=PATH, stiffness_npm=9.0, force_n=x), 5e-324),
    (lambda x: Effect("zone", size_m=(x, 0.0, 0.0), stiffness_npm=9.0), 5e-324),
    (lambda x: Effect("viscous", size_m=(x, 0.0, 0.0), damping_nspm=x), 5e-324),
]


@pytest.mark.parametrize(("make", "least"), SMALLEST)
def test_numbers_next_to_zero_are_refused_or_give_a_finite_force(make: Callable[[float], Effect], least: float) -> None:
    assert unfit_effect(make(least), 2) == ""
    for size in (least, 5e-324, 1e-200, 1e-160):
        rig = EffectForce(2, TICK_S, 0.0)
        rig.fit(capability(2), 1.0)
        fits = not unfit_effect(make(size), 2)
        assert fits is (size >= least)
        assert rig.tell(Effects(1, 1, (1,), 10.0, 1, make(size)), 0) == ("" if fits else "unfit effect")
        for tick in range(32):
            force = rig.step(tick, (1e-3, 1e-3), (0.1, 0.1), 1.0, CARRIED)
            assert force is None or all(map(math.isfinite, force))


@given(law=st.floats(-20.0, 20.0), applied=st.floats(-20.0, 20.0))
def test_no_more_of_a_force_is_taken_for_effects_than_was_asked(law: float, applied: float) -> None:
    """law: of coupling and effects, which may cancel out while slope limits still hold a force."""
    effects = force_of(Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=500.0))
    for tick in range(64):
        effects.step(tick, (-1e-3,), (0.0,), 1.0, CARRIED)
    asked = effects.step(64, (0.01,), (0.0,), 1.0, CARRIED)
    assert asked is not None
    effects._law = (law,)
    effects.enter(1, (applied,), (applied,), (0.01,), (0.01,))
    assert all(0.0 <= own <= all_of for own, all_of in zip(effects.acted_n, asked, strict=True))


def test_viscous_field_has_its_coefficient() -> None:
    effects = force_of(Effect("viscous", size_m=(0.05, 0.0, 0.0), damping_nspm=5.0))
    found = dict(held(effects, 512, lambda tick: 0.1 * tick * TICK_S))
    forces = [force for place, force in found.items() if 0.005 < place < 0.045]
    assert np.allclose(forces, 0.5, rtol=0.01)


@pytest.mark.parametrize(("carried", "expected"), [((50.0, 1e5), 8.0), ((22.0, 1e5), 2.0), ((20.0, 1e5), 0.0)])
def test_dampers_get_what_the_coupling_leaves_of_the_device(carried: tuple[float, float], expected: float) -> None:
    effects = EffectForce(1, TICK_S, 20.0)
    effects.fit(capability(), 1.0)
    effects.tell(Effects(1, 1, (1,), 1.0, 1, Effect("viscous", damping_nspm=8.0)), 0)
    force = [effects.step(tick, (0.0,), (1.0,), 1.0, carried) for tick in range(64)][-1]
    assert force is not None
    assert force[0] == pytest.approx(expected)
    assert effects.reduced is (expected < 8.0)


def test_springs_are_no_stiffer_than_the_device_carries() -> None:
    effects = force_of(Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=4000.0))
    for tick in range(64):
        effects.step(tick, (-0.001,), (0.0,), 1.0, (50.0, 1000.0))
    force = [effects.step(tick, (0.001,), (0.0,), 1.0, (50.0, 1000.0)) for tick in range(64, 128)][-1]
    assert force is not None
    assert force[0] == pytest.approx(1.0)


def test_texture_is_no_stiffer_than_the_device_carries_and_draws_from_the_tank() -> None:
    effect = Effect("texture", direction=(1.0, 0.0, 0.0), amplitude_n=1.0, period_m=0.002)
    assert Texture(effect, 1).stiffness_npm == pytest.approx(1000.0 * math.pi)
    effects = force_of(effect, tank_mj=5.0)
    peak = 0.0
    for tick in range(64):
        force = effects.step(tick, (0.0005,), (0.0,), 1.0, (50.0, 500.0 * math.pi))
        peak = max(peak, force[0] if force else 0.0)
    assert peak == pytest.approx(0.5)


def test_fixture_around_a_hand_comes_as_far_as_the_tank_pays() -> None:
    """A path 20 mm from the hand stores 40 mJ; the tank has 10 mJ, so a quarter of it is rendered, and nothing is given."""
    effects = force_of(Effect("path", points_m=((0.0, 0.0, 0.0), (0.1, 0.0, 0.0)), stiffness_npm=200.0), axes=2)
    for tick in range(256):
        force = effects.step(tick, (0.05, 0.02), (0.0, 0.0), 1.0, CARRIED)
    assert force is not None
    assert force[1] == pytest.approx(0.25 * 4.0)
    assert effects.stored_j == pytest.approx(0.01)
    assert effects.tank.level_j == pytest.approx(0.0, abs=1e-12)
    for tick in range(256, 300):
        force = effects.step(tick, (0.05, 0.0), (0.0, 0.0), 1.0, CARRIED)  # there it costs nothing
    force = effects.step(300, (0.05, 0.005), (0.0, 0.0), 1.0, CARRIED)
    assert force is not None
    assert force[1] == pytest.approx(1.0)


along = (1.0, 0.0, 0.0)
newtons, stiffnesses = st.floats(0.1, 40.0), st.floats(1.0, 5e3)
ACTIVE = st.one_of(
    st.builds(
        lambda a, f: Effect("vibration", direction=along, amplitude_n=a, frequency_hz=f), newtons, st.floats(1.0, 250.0)
    ),
    st.builds(
        lambda a, p: Effect("texture", direction=along, amplitude_n=a, period_m=p), newtons, st.floats(1e-4, 0.1)
    ),
)
PASSIVE_ONES = st.one_of(
    st.builds(lambda b, h: Effect("viscous", size_m=(h, 0.0, 0.0), damping_nspm=b), newtons, st.floats(0.0, 0.01)),
    st.builds(lambda k, r: Effect("magnet", stiffness_npm=k, radius_m=r), stiffnesses, st.floats(1e-3, 0.05)),
    st.builds(lambda k: Effect("zone", size_m=(0.004, 0.0, 0.0), stiffness_npm=k), stiffnesses),
)


@settings(max_examples=1000)
@given(
    effects=st.lists(ACTIVE, min_size=1, max_size=3),
    more=st.lists(PASSIVE_ONES, max_size=2),
    steps=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(0.0, 1.0)), min_size=1, max_size=40),
    tank_mj=st.floats(0.01, 20.0),
    latency=st.integers(0, 3),
)
@example(
    [Effect("vibration", direction=along, amplitude_n=1.0, frequency_hz=76.0)], [], [(0.0, 1.0), (0.0, 0.0)], 0.5, 1
)
@example(
    [Effect("vibration", direction=along, amplitude_n=1.0, frequency_hz=1.0)],
    [Effect("zone", size_m=(0.004, 0.0, 0.0), stiffness_npm=160.0)],
    [(0.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 0.0)],
    0.0625,
    2,
)
def test_tank_is_never_overdrawn(
    effects: list[Effect], more: list[Effect], steps: list[tuple[float, float]], tank_mj: float, latency: int
) -> None:
    """Whatever the hand does within the device's speed limit, and however the gain of safety falls and rises."""
    rig = EffectForce(1, TICK_S, 0.0)
    rig.fit(capability(latency=latency, speed_mps=1.0), 1.0)
    numbers = tuple(range(1, len(effects + more) + 1))
    for number, each in enumerate(effects + more, 1):
        rig.tell(Effects(1, 1, numbers, tank_mj, number, each), 0)
    place, before, force, given_j = 0.0, 0.0, (0.0,), 0.0
    active = [0.0] * (latency + 1)
    for tick, (step, gain) in enumerate(steps):
        place += step * TICK_S
        rig.enter(1, force, force, (before,), (place,))
        given_j -= active[tick] * (place - before)
        law = rig.step(tick, (place,), (step,), gain, CARRIED)
        rig._law = tuple(law or (0.0,))
        force = (gain * rig._law[0],)
        active.append(gain * rig.active_n[0] if law else 0.0)
        before = place
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
    rig = EffectForce(1, TICK_S, 0.0)
    rig.fit(capability(), 1.0)
    wall = Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=500.0)
    assert rig.tell(Effects(1, 1, (1, 2), 1.0, 1, wall), 0) == ""
    assert rig.known((1, 2)) == (1,)
    assert rig.tell(Effects(1, 1, (1, 2), 1.0, 2, Effect("viscous")), 0) == "unfit effect"  # without a damper
    assert rig.known((1, 2)) == (1, 2)  # it is not told again
    assert rig.tell(Effects(1, 0, (), 1.0), 0) == "late effects"
    assert rig.step(1, (-0.001,), (0.0,), 1.0, CARRIED) is not None
    assert rig.tell(Effects(1, 2, (), 1.0), 1) == ""
    for tick in range(2, 64):
        last = rig.step(tick, (-0.001,), (0.0,), 1.0, CARRIED)
    assert last is None
    for number in range(3, 100):
        rig.tell(Effects(1, 2 + number, (number,), 1.0, number, wall), 64)
    assert len(rig._entries) <= 2 * MOST_EFFECTS


def test_effects_of_a_hand_without_force_make_room_for_others() -> None:
    """A world that goes on while a fault is latched: what it tells last is there once the hand is armed again."""
    rig = EffectForce(1, TICK_S, 0.0)
    rig.fit(capability(), 1.0)
    wall = Effect("zone", direction=(-1.0, 0.0, 0.0), stiffness_npm=500.0)
    for number in range(1, 100):
        assert rig.tell(Effects(1, number, (number,), 1.0, number, wall), number) == ""
        rig.begin_anew()
    assert list(rig._entries) == [99]


def test_burst_ends_by_itself() -> None:
    burst = Effect("vibration", direction=(1.0, 0.0, 0.0), amplitude_n=0.5, frequency_hz=100.0, seconds=0.1)
    forces = [force for _, force in held(force_of(burst), 512, lambda tick: 0.0)]
    assert max(map(abs, forces[60:100])) > 0.4
    assert not any(forces[140:])
