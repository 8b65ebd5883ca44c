"""The damper at the device works on an estimated velocity, of samples that may be old: what that costs (theory section 3.6)."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from math import inf, sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.analysis.advice.delay_budget import budget, total_s
from cogrip.analysis.feel.feel import conditions, on_wall, reflected, slow_feel
from cogrip.analysis.linear import client_blocks
from cogrip.analysis.linear.client_blocks import wave_frame
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearSession, linear_session, seat_session
from cogrip.analysis.linear.rigid_motion import Rigid
from cogrip.analysis.linear.stability import largest_stable, verdict
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.hand.velocity import MotionObserver, largest_impedance, memory_for
from cogrip.client.inputs import DeviceOpened
from cogrip.devices.device import Capability
from cogrip.devices.registry import make
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.bench.velocity_trial.session import LOOSE, EstimatingPlant
from tests.docs.pages import page, table
from tests.extent import every, long
from tests.interpreted import needs_interpreted
from tests.sim.session_measures import FRAME_MS, laboratory_of, run_frames

T_C = 1.0 / 1024
PHANTOM = make("sim:phantom").capability
EXACT = "sim:phantom?friction_n=0&resolution_m=0"


def session(mass_kg: float, memory: float | None = None, **coupling: float):
    """Return two reaching hands; with `memory` in place of the client's own."""
    users = [
        {"name": "anna", "hand": "reach", "device_mass_kg": mass_kg},
        {"name": "ben", "hand": "reach&delay_s=0.15", "device_mass_kg": mass_kg},
    ]
    laboratory = laboratory_of(
        bare=True, seconds=2.5, link={"delay_ms": 20.0}, playout={"frames": 1}, users=users, coupling=coupling
    )
    for person in laboratory.people:
        own = memory_for(person.device.capability, T_C) if memory is None else memory
        person.device.plant = EstimatingPlant(person.device.plant, MotionObserver(1, T_C, own), 0)
    laboratory.run()
    return of_laboratory(laboratory)["users"]


@pytest.mark.parametrize("mass_kg", every(3, [0.045, 0.075, 0.1]))
def test_a_light_arm_stays_quiet(mass_kg: float) -> None:
    for user in session(mass_kg):
        assert user["peak_force_n"] < 2.0
        assert user["energy"]["device_leak_j"] > -0.05


def test_a_slower_estimate_would_not_do() -> None:
    assert min(user["energy"]["device_leak_j"] for user in session(0.045, 0.8, impedance_nspm=20.0)) < -1.0


# Old samples in the lifted model --------------------------------------------------------------------------------------


def late_session(
    latency: int, *, scheme: str = "wave", kind: str = "cube", estimated: bool = True, frames: int = 1,
    person: Mapping[str, float] = {}, **keys: object,
) -> LinearSession:  # fmt: skip
    """Return the model of two people with Phantoms; `person`: what else both of them have."""
    users = [{"name": name, "device": "sim:phantom?hand=hold"} for name in ("a", "b")]
    table = {"coupling": {"kind": scheme, **keys}, "object": {"kind": kind}, "users": users}
    found = linear_session(resolve(table), delay_frames=frames, estimated=False)
    return with_everybody(found, **{"latency_ticks": latency, "estimated": estimated, "mass_known": inf, **person})


def with_everybody(found: LinearSession, **changes: Any) -> LinearSession:
    return replace(found, people=tuple(replace(person, **changes) for person in found.people))


@pytest.mark.parametrize("latency", [0, 1, 2])
@pytest.mark.parametrize("estimated", [False, True])
@pytest.mark.parametrize(
    ("scheme", "keys"),
    [("wave", {}), ("wave", {"decimator": "lowpass"}), ("coupling", {}), ("coupling", {"stiffness_npm": 0.0})],
)
def test_what_the_structure_puts_at_1_is_known_with_old_samples_too(
    latency: int, estimated: bool, scheme: str, keys: dict[str, object]
) -> None:
    model = LiftedModel(late_session(latency, scheme=scheme, estimated=estimated, **keys))
    assert Rigid(model).residual(model.matrix()) < 1e-12


@pytest.mark.parametrize("latency", [0, 1, 3, 9])
def test_a_wall_is_as_much_softer_as_the_path_is_longer(latency: int) -> None:
    """A wave that is booked late comes back late: 1 / K_felt = 1 / K + (T_forward + T_back + T_n + L T_c) / (2 b)."""
    found = late_session(latency)
    felt = slow_feel(on_wall(found, 0), 0).stiffness_npm
    person = found.people[0]
    way_s = 3 * FRAME_MS * 1e-3 + latency * T_C
    assert total_s(budget(found, 0)) == pytest.approx(way_s, abs=1e-12)
    assert 1.0 / felt == pytest.approx(1.0 / person.stiffness_npm + way_s / (2.0 * person.impedance_nspm), rel=1e-6)
    assert next(stage.delay_s for stage in budget(found, 0) if stage.name == "encoder") == (0.5 + latency) * T_C


def let_age(laboratory: Laboratory, latency: int, memory: float = 0.5) -> None:
    """Make everybody's samples as old as their records say, with velocities estimated from these."""
    for person in laboratory.people:
        person.device.plant = EstimatingPlant(person.device.plant, MotionObserver(1, T_C, memory), latency)
        person.core.handle(DeviceOpened(replace(person.core.capability, latency_ticks=latency)), person.core.now_ns)


@pytest.mark.parametrize("latency", every(3, (2, 0, 1)))
def test_a_session_feels_as_its_own_account_predicts(latency: int) -> None:
    """The actual cores, a wall, one frame each way: felt at rest, predicted from the measured loop, and theory with L T_c."""
    users = [{"name": "a", "device": "sim:ideal", "hand": "push"}]
    laboratory = laboratory_of(seconds=4, object={"kind": "wall"}, link={"delay_ms": FRAME_MS}, users=users)
    let_age(laboratory, latency)
    laboratory.run()
    (user,) = of_laboratory(laboratory)["users"]
    felt = 1.0 / (1e-3 + (3 * FRAME_MS * 1e-3 + latency * T_C) / (2.0 * 20.0))
    assert user["predicted_stiffness_npm"] == pytest.approx(felt, rel=1e-9)
    assert user["felt_stiffness_npm"] == pytest.approx(felt, rel=0.002)
    assert abs(felt - 630.5) > 5.0 * latency


@given(
    st.sampled_from(("boxcar", "lowpass", "none")),
    st.sampled_from(("displacement", "velocity")),
    st.integers(0, 11),
    st.floats(0.05, 3.1),
)
def test_what_a_device_that_is_held_still_sends_back(decimator: str, encoder: str, latency: int, angle: float) -> None:
    """The closed form of `feel` is the block of a device that nothing moves."""
    found = late_session(latency, decimator=decimator, encoder=encoder)
    z = np.exp(1j * np.array([angle]))
    still = wave_frame(replace(found.people[0], device_mass_kg=1e15), found.people[0].rates)
    np.testing.assert_allclose(reflected(found.people[0], found.people[0].rates, z), still.response(z), atol=1e-9)


@pytest.mark.parametrize("scheme", ["wave", "coupling"])
@pytest.mark.parametrize("estimated", [False, True])
def test_impedance_in_closed_form_is_the_lifted_models_with_old_samples(scheme: str, estimated: bool) -> None:
    """The other hands' frames come from the blocks, the moving one's from the closed form; both know the age."""
    hz = np.array([2.0])
    young, old = (
        conditions(late_session(latency, scheme=scheme, estimated=estimated), 0, hz)[-1].rendered[0]
        for latency in (0, 2)
    )
    turn = np.exp(-1j * 2.0 * np.pi * 2.0 * 2 * T_C)
    assert abs(old - young) > 1e-4 * abs(young)
    assert abs(old / young - turn) < 0.05


# The wave that an old sample goes with ---------------------------------------------------------------------------------


def with_the_wave_of_now(patch: pytest.MonkeyPatch) -> None:
    """Return the model that books an old displacement with the current wave."""
    patch.setattr(WaveCoupling, "set_latency", lambda self, ticks: None)
    patch.setattr(client_blocks, "booked_late", lambda person: 0)


LIGHT = {"device_mass_kg": 0.075, "memory": 0.5}
LARGEST_K = {float(b): tuple(map(float, row)) for b, *row in table(page("docs/velocity.md"), "b N s/m")}
"""b -> the largest stable K [N/m] with the wave of now, of then, and with fresh samples."""


@needs_interpreted
@pytest.mark.parametrize("b", every(3, LARGEST_K))
def test_the_largest_stiffness_with_old_samples(b: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cube and wall, one and four frames in each direction, 75 g, memory 0.5, free hands."""

    def largest(latency: int) -> float:
        limits = []
        for kind, frames in ((kind, frames) for kind in ("cube", "wall") for frames in (1, 4)):
            found = late_session(latency, frames=frames, kind=kind, impedance_nspm=b, person=LIGHT)
            limits.append(largest_stable(LiftedModel(found)).stiffness_npm or np.inf)
        return min(limits)

    old, new, fresh = LARGEST_K[b]
    assert largest(1) == pytest.approx(new, rel=0.005)
    assert largest(0) == pytest.approx(fresh, rel=0.005)
    with_the_wave_of_now(monkeypatch)
    assert largest(1) == pytest.approx(old, rel=0.005)


@pytest.mark.sample(1)
@pytest.mark.parametrize("paired", [True, False])
def test_sessions_of_the_cores_decay_with_the_wave_of_then_and_grow_with_that_of_now(
    paired: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Free devices, K = 2000, b = 2, one frame in each direction, one push of 1 um/s: 0.9974 and 1.0043 a frame."""
    if not paired:
        with_the_wave_of_now(monkeypatch)
    users = [{"name": name, "device": EXACT, "hand": "push&force_n=0", "device_mass_kg": 0.075} for name in ("a", "b")]
    keys = {"impedance_nspm": 2.0, "stiffness_npm": 2000.0}
    laboratory = laboratory_of(coupling=keys, users=users, link={"delay_ms": FRAME_MS})
    let_age(laboratory, 1)
    for person, sign in zip(laboratory.people, (1.0, -0.4), strict=True):
        person.device.plant.velocity_mps[0] = sign * 1e-6
    peaks = []
    for _ in range(6):
        laboratory.people[0].core.seated.peaks.force_n = 0.0
        run_frames(laboratory, 64)
        peaks.append(laboratory.people[0].core.seated.peaks.force_n)
    growth = (peaks[-1] / peaks[1]) ** (1.0 / (4 * 64))
    assert growth == pytest.approx(0.9974 if paired else 1.0043, abs=6e-4)


# The bound of the record against sessions -----------------------------------------------------------------------------


def device(mass_kg: float, latency: int) -> Capability:
    return replace(PHANTOM, apparent_mass_kg=mass_kg, latency_ticks=latency)


@pytest.mark.parametrize(
    ("mass_kg", "latency"), every(3, [(0.03, 0), (0.045, 0), (0.075, 0), (0.075, 1), (0.045, 1), (0.1, 0), (0.075, 2)])
)
@pytest.mark.parametrize("stiffness_npm", [300.0, 1000.0])
def test_a_session_is_stable_with_the_largest_impedance_whatever_the_mass(
    mass_kg: float, latency: int, stiffness_npm: float
) -> None:
    """A record may say a third too much, or half of it; a session in which positions alone are known ends not far above."""
    record = device(mass_kg, latency)
    largest = largest_impedance(record, T_C).impedance_nspm

    def stable(b: float, kind: str, frames: int, mass_known: float) -> bool:
        keys = {"coupling.impedance_nspm": b, "coupling.stiffness_npm": stiffness_npm, "object.kind": kind}
        found = seat_session(
            seat_settings(resolve({"link": {"delay_ms": frames * FRAME_MS}, "users": [{"name": "a"}]}, keys), 0), record
        )
        return verdict(LiftedModel(with_everybody(found, mass_known=mass_known))).stable

    cases = [(kind, frames) for kind in ("cube", "wall") for frames in (0, 1, 4)]
    inside = [(share * largest, *case) for case in cases for share in (0.5, 0.75, 1.0)]
    assert [each for each in product(inside, (0.5, 1.0, 1.33)) if not stable(*each[0], each[1])] == []
    assert not all(stable(4.0 * largest, *case, inf) for case in cases)


@pytest.mark.long
@pytest.mark.parametrize(("mass_kg", "latency"), [long(0.05, 0), long(0.1, 0), (0.1, 1)])
def test_the_model_with_old_samples_ends_where_sessions_of_the_cores_end(mass_kg: float, latency: int) -> None:
    """Two devices loosely held, without counts and friction, rest up to the b of the model, within 8 %."""
    record = replace(device(mass_kg, latency), resolution_m=0.0)
    memory = memory_for(record, T_C)

    def quiet(b: float) -> bool:
        users = [{"name": name, "device": f"{EXACT}&hand={LOOSE}", "device_mass_kg": mass_kg} for name in ("a", "b")]
        coupling, link = {"impedance_nspm": b}, {"delay_ms": FRAME_MS}
        laboratory = laboratory_of(bare=True, seconds=3.0, coupling=coupling, link=link, users=users)
        let_age(laboratory, latency, memory)
        for person, sign in zip(laboratory.people, (1.0, -0.4), strict=True):
            person.device.plant.velocity_mps[0] = sign * 0.05
        laboratory.run()
        cores = [person.core for person in laboratory.people]
        return all(core.safety.state == "live" and abs(core.force_n[0]) < 0.05 for core in cores)

    def stable(b: float) -> bool:
        users = [
            {"name": name, "device": f"sim:phantom?hand={LOOSE}", "device_mass_kg": mass_kg} for name in ("a", "b")
        ]
        table = {"coupling": {"impedance_nspm": b}, "link": {"delay_ms": FRAME_MS}, "users": users}
        model = linear_session(resolve(table), hands=True, estimated=True)
        return verdict(LiftedModel(with_everybody(model, latency_ticks=latency, memory=memory))).stable

    low, high = 5.0, 128.0
    for _ in range(12):
        middle = sqrt(low * high)
        low, high = (middle, high) if stable(middle) else (low, middle)
    assert quiet(low / 1.08)
    assert not quiet(high * 1.08)


def test_seats_take_memory_and_age_from_the_record() -> None:
    record = device(0.075, 1)
    (person,) = seat_session(seat_settings(resolve({"users": [{"name": "a"}]}), 0), record).people
    assert (person.memory, person.latency_ticks) == (memory_for(record, T_C), 1)


SHARES = {
    0: {0.0: 1.29, 0.3: 1.235, 0.4: 0.496, 0.5: 0.427, 0.6: 0.379, 0.7: 0.251, 0.8: 0.178},
    1: {0.0: 0.828, 0.3: 0.42, 0.4: 0.409, 0.5: 0.353, 0.6: 0.259, 0.7: 0.21, 0.8: 0.156},
}
"""L -> memory -> b T / m at which some session of free devices of 75 g ends: the table of docs/velocity.md."""


@pytest.mark.sample(1)
@pytest.mark.parametrize(("memory", "latency"), every(9, product(SHARES[0], SHARES)))
def test_how_far_sessions_go(memory: float, latency: int) -> None:
    """Cube and wall, one and four frames in each direction, K = 500 N/m: all stable 2 % below the limit, one not 2 % above."""

    def stable(share: float, kind: str, frames: int) -> bool:
        b, person = share * 0.075 / T_C, {"device_mass_kg": 0.075, "memory": memory}
        found = late_session(latency, kind=kind, frames=frames, person=person, impedance_nspm=b, stiffness_npm=500.0)
        return verdict(LiftedModel(found)).stable

    cases = [(kind, frames) for kind in ("cube", "wall") for frames in (1, 4)]
    end = SHARES[latency][memory]
    assert all(
        stable(share, *case) for case in cases for share in np.geomspace(5.0 * T_C / 0.075, 0.98 * end, 12).tolist()
    )
    assert not all(stable(1.02 * end, *case) for case in cases)
    lag = latency + (1.0 + memory) / (1.0 - memory)
    assert 1.15 < end * lag < 2.4, "the bound, and how much further it goes"
