"""The lifted model against one frame of the very classes of a session, and both against theory section 6.

The frame of the cores is linear (in touch: affine), so its matrix has for columns what one frame makes of each unit state.
Delays are explicit delay lines here: no datagram, no ramp. States stand as in `LiftedModel.layout`.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import (
    LinearPerson,
    ModelError,
    form_overrides,
    linear_session,
    rounding_notes,
)
from cogrip.analysis.linear.stability import verdict
from cogrip.client.coupling.virtual_coupling import VirtualCoupling
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.client.hand.velocity import MotionObserver
from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings
from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.settings.delays import OneWayDelay
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import Stamp, State
from cogrip.server.schemes import make_world
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.lagged import PaperWorld
from cogrip.server.worlds.world import World

from tests.docs.pages import page, table

Array = NDArray[np.float64]
TABLE = table(page("docs/theory.md"), "scheme")
STIFFNESSES_NPM = (100, 500, 1000, 2000, 5000, 10000, 20000)  # its columns
TOUCH_M = 10.0  # how deep inside a one-sided contact its map is taken
NUDGE = 1e-3


def axes(row: list[float]) -> list[float]:
    """Fill up to as many axes as there may be."""
    return row + [0.0] * (POSE_AXES - len(row))


class Device:
    """A client's device and its samples at the start of a frame: `state`, in the order of the blocks' states."""

    def __init__(self, plant: IdealPlant, person: LinearPerson, state: Array, rates: Rates) -> None:
        late = person.latency_ticks
        self.plant, self.person, self.rates = plant, person, rates
        own = 3 + late if person.observes else 2 if person.estimated else late
        self.states = 2 + own + late
        self.speeds = deque([*state[2 : 2 + late][::-1], state[1]])
        places = state[0] - rates.tick_s * np.cumsum([0.0, *state[2 + own : self.states]])
        self.places = deque(places[::-1].tolist(), maxlen=late + 1)  # oldest first
        self.estimator = MotionObserver(
            1, rates.tick_s, person.memory, (person.device_mass_kg,) if person.observes else (), late
        )
        if person.estimated:
            self.estimator._begun = True
            self.estimator._estimate_m = axes([state[2] + self.places[0]])
            self.estimator._velocity[0] = state[3]
        if person.observes:
            self.estimator._accelerations = axes([state[4]])
            self.estimator._forces = deque((force,) for force in state[5 : 5 + late][::-1])
            self.estimator._now()

    def read(self) -> tuple[list[float], list[float]]:
        return [self.places[0]], [self.estimator._newest[0] if self.person.estimated else self.speeds[0]]

    def step(self, held: float, force: Sequence[float]) -> float:
        """Run one tick; return the displacement that the next sample shows."""
        before = self.places[0]
        self.plant.step((held,), force)
        self.places.append(self.plant.position_m[0])
        self.estimator.hold(force, 1)
        self.estimator.update([self.places[0]])
        self.speeds.append(self.plant.velocity_mps[0])
        self.speeds.popleft()
        return self.places[0] - before

    def state(self) -> list[float]:
        old = np.diff(self.places)[::-1] * self.rates.device_hz
        own = list(self.speeds)[:-1][::-1]
        if self.person.estimated:
            found = self.estimator
            own = [found._estimate_m[0] - self.places[0], found._velocity[0]]
            if self.person.observes:
                own += [found._accelerations[0], *[force[0] for force in found._forces][::-1]]
        return [self.plant.position_m[0], self.plant.velocity_mps[0], *own, *old]


class CoresFrame:
    """One frame of the actual cores: `matrix`, in the order of `layout`."""

    def __init__(self, settings: Settings, model: LiftedModel) -> None:
        self.session = model.session
        self.layout = model.layout
        self.size = model.states
        self.seats = [seat_settings(settings, number) for number in range(len(settings.users))]
        self.deep = self.seats[0].one_sided
        self.sides = [seat.side_sign for seat in self.seats]
        self.rates = self.session.people[0].rates
        self.ticks = self.rates.ticks_per_frame

    def matrix(self) -> Array:
        base = self.touching()
        start = self.frame(base)
        step = NUDGE if self.deep else 1.0
        return np.array([(self.frame(base + step * unit) - start) / step for unit in np.eye(self.size)]).T

    def touching(self) -> Array:
        """A state to begin at: nothing, or everyone deep inside a contact that only pushes."""
        state = np.zeros(self.size)
        if not self.deep:
            return state
        for number, side in enumerate(self.sides):
            if self.session.form == "coupling":
                state[self.layout.clients[number].start] = side * TOUCH_M
                state[self.layout.ups[number]][0::2] = side * TOUCH_M
            else:
                state[self.layout.server.start + number] = side * TOUCH_M
        return state

    def device(self, person: LinearPerson, state: Array) -> Device:
        settings = IdealSettings(mass_kg=person.device_mass_kg, damping_nspm=person.device_damping_nspm)
        plant = IdealPlant(settings, 1)
        plant.open(self.rates.device_hz, person.hand_stiffness_npm, person.hand_damping_nspm, (state[0],))
        plant.velocity_mps = [state[1]]
        return Device(plant, person, state, self.rates)

    def push(self, person: LinearPerson, client: WaveCoupling | VirtualCoupling) -> float:
        """Return the force that holds a device deep inside a wall, which pushes back at the device's own rate."""
        if not self.deep or isinstance(client, WaveCoupling):
            return 0.0
        side = self.sides[self.session.people.index(person)]
        return side * TOUCH_M * (person.stiffness_npm + person.hand_stiffness_npm)

    def run_ticks(self, client: WaveCoupling | VirtualCoupling, person: LinearPerson, device: Device) -> float:
        """Run M ticks in the order of `ClientCore`; return the wave sent."""
        held, sent = self.push(person, client), 0.0
        for tick in range(self.ticks):
            place, velocity = device.read()
            client.elapse([device.step(held, client.force(place, velocity)) * self.rates.device_hz], velocity)
            if isinstance(client, WaveCoupling) and tick + 1 == self.ticks - person.split_ticks:
                (sent,) = client.up.decimator.take()
        return sent

    def frame(self, state: Array) -> Array:
        return self.coupled_frame(state) if self.session.form == "coupling" else self.wave_frame(state)

    def wave_frame(self, state: Array) -> Array:
        layout, out = self.layout, np.empty(self.size)
        arrived: list[float] = []
        lags: list[float] = []
        contents: list[float] = []
        for number, (person, seat) in enumerate(zip(self.session.people, self.seats, strict=True)):
            down, own, up = state[layout.downs[number]], state[layout.clients[number]], state[layout.ups[number]]
            client, device = WaveCoupling(seat), self.device(person, own)
            booked = person.latency_ticks if person.encoder == "displacement" else 0
            client.set_latency(booked)
            for wave in own[device.states : device.states + booked][::-1].tolist():
                client.late.push(((wave,), 1.0, 1.0, None, client.b))
            lag = person.filter_lag_s * person.rates.device_hz
            if lag:  # its state stands behind the waves on the way down, and before those on the way up
                client.down.filter._content, client.up.filter._content = [lag * float(down[-1])], [lag * float(up[0])]
                down, up = down[:-1], up[1:]
            client._play((float(down[-1]),), self.ticks)
            split = person.split_ticks > 0 and person.decimator == "boxcar"  # others send a frame's last sample alone
            if person.decimator == "lowpass":
                client.up.decimator._state = [float(own[-1])]
            if split:
                client.up.decimator._sum = axes([float(own[-1]) * self.ticks])
            sent = self.run_ticks(client, person, device)
            waves = [client.late.push(((0.0,), 1.0, 1.0, None, client.b))[0][0] for _ in range(booked)]  # oldest first
            after = [*device.state(), *reversed(waves)]
            if person.decimator == "lowpass":
                after += client.up.decimator._state
            if split:  # what the next frame has of this one
                after.append(client.up.decimator._sum[0] / self.ticks)
            out[layout.clients[number]] = after
            (sent,) = client.up.filter.step((sent,), self.ticks)
            arrived.append(up[-1] if up.size else sent)
            kept = [client.up.filter._content[0] / lag] if lag else []
            out[layout.ups[number]] = np.append(kept, np.append(sent, up)[: up.size])
            lags.append(lag)
            contents.append(client.down.filter._content[0])
        world = self.world(state[layout.server])
        answers = world.step(np.array(arrived)[:, None])[:, 0]
        for number, answer in enumerate(answers):
            waves = np.append(answer, state[layout.downs[number]])
            lag = lags[number]
            out[layout.downs[number]] = np.append(waves[:-2], contents[number] / lag) if lag else waves[:-1]
        out[layout.server] = self.read(world)
        return out

    def coupled_frame(self, state: Array) -> Array:
        layout, out = self.layout, np.empty(self.size)
        world = make_world(self.seats)
        for number in range(len(self.seats)):
            world.join(number, np.zeros(1))
        server = state[layout.server]
        if not self.session.fixed:
            world.position, world.velocity = server[:1].copy(), server[1:].copy()
        devices = [
            self.device(person, state[own]) for person, own in zip(self.session.people, layout.clients, strict=True)
        ]
        told = [np.concatenate(device.read()) for device in devices]
        ups = [np.concatenate((new, state[up])) for new, up in zip(told, layout.ups, strict=True)]  # newest first
        answers = world.step(np.array([up[-2:] for up in ups]))
        for number, (person, seat, device) in enumerate(zip(self.session.people, self.seats, devices, strict=True)):
            down, client = np.concatenate((answers[number], state[layout.downs[number]])), VirtualCoupling(seat)
            client.receive(State(1, 0, (float(down[-2]),), (float(down[-1]),), 0.0, 0, Stamp(0)))
            client.start_frame()
            self.run_ticks(client, person, device)
            out[layout.clients[number]] = device.state()
            out[layout.ups[number]] = ups[number][:-2]
            out[layout.downs[number]] = down[:-2]
        out[layout.server] = [] if self.session.fixed else [world.position[0], world.velocity[0]]
        return out

    def world(self, server: Array) -> World:
        N = len(self.seats)
        world = make_world(self.seats)
        world.stiffness, world.damping = world.target_stiffness.copy(), world.target_damping.copy()
        world.holding[:] = True
        place = 0.0
        if not self.session.fixed:
            world.position, world.velocity = server[N : N + 1].copy(), server[N + 1 : N + 2].copy()
            place = server[N]
        if isinstance(world, GripWorld):
            world.stretch = server[:N, None].copy()
        else:
            world.hand = server[:N, None] + place
        if isinstance(world, PaperWorld):
            world.force = server[-N:, None].copy()
        if self.deep and not self.session.fixed:  # what keeps a free object between faces that press unequally
            K, G = world.stiffness[:, 0], world.damping[:, 0] + world.stiffness[:, 0] * world.frame_s
            world.external_force[0] = -(world.side * K * TOUCH_M / (1.0 + G / world.impedance[:, 0])).sum()
        return world

    def read(self, world: World) -> Array:
        stretch = world.stretch if isinstance(world, GripWorld) else world.hand - world.position
        parts = [stretch[:, 0]]
        if not self.session.fixed:
            parts += [world.position, world.velocity]
        if isinstance(world, PaperWorld):
            parts.append(world.force[:, 0])
        return np.concatenate(parts)


def both(scheme: str, stiffness: float, delay: int, **coupling: Any) -> tuple[Settings, LiftedModel]:
    """Return theory section 6's two users."""
    table: dict[str, Any] = {"coupling": coupling, "users": [{"name": "a"}, {"name": "b"}]}
    resolved = resolve(table, {**form_overrides(scheme), "coupling.stiffness_npm": float(stiffness)})
    return resolved, LiftedModel(linear_session(resolved, delay_frames=delay, estimated=False))


def largest(matrix: Array) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[0]}-{row[1]}")
def test_the_cores_have_the_eigenvalues_of_theory_6(row: list[str]) -> None:
    """`tests/docs/test_theory.py` holds them against the model alone."""
    scheme, delay, *radii = row
    for stiffness_npm, radius in zip(STIFFNESSES_NPM, radii, strict=True):
        if radius != "-":
            resolved, model = both(scheme, stiffness_npm, int(delay))
            assert f"{largest(CoresFrame(resolved, model).matrix()):.4f}" == radius, stiffness_npm
            assert verdict(model).stable == (radius == "1.0000")


@st.composite
def sessions(draw: st.DrawFn) -> tuple[Settings, LiftedModel]:
    """Draw any session that has a linear model."""
    scheme = draw(st.sampled_from(("passive", "paper", "coupling")))
    kind = draw(st.sampled_from(("cube", "wall", "faces") if scheme == "passive" else ("cube", "wall")))
    M = draw(st.sampled_from((1, 2, 4, 8, 16)))
    network_hz = 256 if M == 1 else 128  # a hand's loop runs at 250 Hz at least
    estimated = draw(st.booleans())

    def user(number: int) -> dict[str, Any]:
        hand = f"hand_stiffness_npm={draw(st.sampled_from((0.0, 300.0)))}&hand_damping_nspm={draw(st.floats(0.0, 8.0))}"
        return {
            "name": f"user{number}",
            "device": "sim:phantom?friction_n=0&resolution_m=0" if estimated else "sim:ideal",
            "hand": f"hold&{hand}",
            "side": draw(st.sampled_from(("left", "right"))),
            "device_mass_kg": draw(st.floats(0.02, 1.0)),
            "device_damping_nspm": draw(st.sampled_from((0.0, 0.7))),
            "stiffness_npm": draw(st.floats(1.0, 2e4)),
            "damping_nspm": draw(st.floats(0.1, 50.0)),
            "impedance_nspm": draw(st.floats(2.0, 80.0)),
            "decimator": draw(st.sampled_from(("boxcar", "lowpass", "none"))),
            "encoder": draw(st.sampled_from(("displacement", "velocity"))),
            "wave_filter_hz": draw(st.sampled_from((0.0, 0.5, 5.0, 60.0))) if scheme != "coupling" else None,
        }

    table = {
        "rates": {"device_hz": network_hz * M, "network_hz": network_hz},
        "coupling": {
            "kind": "coupling" if scheme == "coupling" else "wave",
            "server_step": "paper" if scheme == "paper" else "passive",
            "lowpass_rad_s": draw(st.floats(5.0, 500.0)),
        },
        "object": {
            "kind": kind,
            "mass_kg": draw(st.floats(0.05, 3.0)),
            "damping_nspm": draw(st.sampled_from((0.0, 2.0))),
        },
        "users": [user(number) for number in range(draw(st.integers(1, 4)))],
    }

    def old() -> dict[str, Any]:
        return {"latency_ticks": draw(st.integers(0, 3)), "memory": draw(st.floats(0.0, 0.8))}

    resolved = resolve(table)
    session = linear_session(resolved, hands=True, estimated=estimated)
    ticks = st.integers(0, 4 * M) if scheme != "coupling" else st.integers(0, 4).map(lambda frames: frames * M)
    delays = [[OneWayDelay(float(draw(ticks)), 0.0, 0.0, 0.0, M) for _ in "ud"] for _ in session.people]
    people = zip(session.people, delays, strict=True)
    session = replace(
        session, people=tuple(replace(person, up=up, down=down, **old()) for person, (up, down) in people)
    )
    if scheme == "coupling" and kind == "wall":  # a device unstable by itself would leave the wall within the frame
        assume(all(_tame(person, session.people[0].rates.tick_s) for person in session.people))
    return resolved, LiftedModel(session)


def _tame(person: LinearPerson, tick_s: float) -> bool:
    stiff = (person.stiffness_npm + person.hand_stiffness_npm) * tick_s**2
    jump = person.damping_nspm * 0.25 * NUDGE / tick_s  # of the damper, by an estimated position that is off by a nudge
    touches = not person.estimated or jump < 0.5 * person.stiffness_npm * TOUCH_M
    age = 1.0 + person.latency_ticks
    return touches and age * person.damping_nspm * tick_s + age**2 * stiff < 0.5 * person.device_mass_kg


@given(sessions())
@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
def test_the_model_is_one_frame_of_the_actual_cores(case: tuple[Settings, LiftedModel]) -> None:
    resolved, model = case
    frame = CoresFrame(resolved, model)
    ours, cores = model.matrix(), frame.matrix()
    assert ours.shape == cores.shape
    # the last bit of a place deep inside a contact, in a velocity
    bit = np.spacing(TOUCH_M) * frame.rates.device_hz / NUDGE if frame.deep else 0.0
    np.testing.assert_allclose(ours, cores, rtol=0.0, atol=(1e-9 + bit) * max(1.0, np.abs(cores).max()))


@given(sessions(), st.floats(0.1, 3.0), st.floats(1.1, 1.5))
@settings(max_examples=60, deadline=None)
def test_characteristic_is_the_closed_loops_over_the_open_ones(
    case: tuple[Settings, LiftedModel], angle: float, size: float
) -> None:
    """det(z - A) = det(z - A_G) det(z - A_S) det(I - S G): zero where an eigenvalue is."""
    _, model = case
    z = np.array([size * np.exp(1j * angle)])
    K = np.array(model.session.stiffness_npm)
    opened = [model.client(number, K).A for number in range(model.users)]
    opened += [model.kind.server(model.session, K).A, *(line.A for line in (*model._ups, *model._downs))]
    sign, log = zip(*(np.linalg.slogdet(z[0] * np.eye(len(A)) - A) for A in opened), strict=True)
    sign_closed, log_closed = np.linalg.slogdet(z[0] * np.eye(model.states) - model.matrix())
    found = model.characteristic(z, K[None])[0]
    assert np.log(abs(found)) + sum(log) == pytest.approx(log_closed, abs=1e-6)
    phase = found / abs(found) * np.prod(sign) / sign_closed
    assert abs(phase - 1.0) < 1e-6


def test_a_batch_of_stiffnesses_is_each_by_itself() -> None:
    for scheme in ("passive", "paper", "coupling"):
        _, model = both(scheme, 1000, 2)
        K = np.array([[[10.0, 20.0], [300.0, 4.0]], [[5e3, 1e2], [7.0, 7.0]]])
        batch = model.matrix(K)
        for index in np.ndindex(2, 2):
            np.testing.assert_allclose(batch[index], model.matrix(K[index]), rtol=1e-12, atol=1e-12)


def test_each_direction_has_its_own_delay_in_ticks() -> None:
    link = {"up": {"delay_ms": 9 * 1000 / 1024}, "down": {"delay_ms": 20.0}}
    table = {"link": link, "playout": {"frames": 1}, "users": [{"name": "a"}]}
    session = linear_session(resolve(table), estimated=False)
    up, down = session.people[0].up, session.people[0].down
    assert (up.link_ticks, up.tick_wait_ticks, up.frame_wait_ticks, up.frames) == (9.0, 0.0, 7.0, 3)
    assert (down.tick_wait_ticks, down.frame_wait_ticks, down.frames) == (pytest.approx(0.52), 3.0, 4)
    notes = rounding_notes(session)
    assert len(notes) == 2
    coupled = {"coupling": {"kind": "coupling"}, "playout": {"frames": 3}, "users": [{"name": "a"}]}
    assert linear_session(resolve(coupled), estimated=False).people[0].up.frames == 0, "it has no playout"
    assert rounding_notes(both("paper", 1000, 3)[1].session) == (), "whole frames need no note"
    assert "8.78906 ms is 9 device ticks; it is played at the next frame border, after 16 ticks or 2 frames" in notes[0]
    assert "20.48 device ticks, no whole number: taken as 21" in notes[1]


@pytest.mark.parametrize("scheme", ["paper", "coupling"])
def test_a_scheme_that_does_not_fit_the_object_is_refused(scheme: str) -> None:
    faces = resolve({"object": {"kind": "faces"}, "users": [{"name": "a"}]}, form_overrides(scheme))
    with pytest.raises(ModelError, match=r'does not fit object\.kind = "faces"'):
        linear_session(faces, estimated=False)


@pytest.mark.parametrize("frames", [-0.1, 256.1])
def test_a_delay_out_of_bounds_is_refused(frames: float) -> None:
    with pytest.raises(ModelError, match="out of 0 to 256"):
        linear_session(resolve({}), delay_frames=frames, estimated=False)
