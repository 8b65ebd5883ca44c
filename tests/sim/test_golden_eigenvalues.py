"""One network frame as a matrix, built from the very classes of a session; its largest |eigenvalue| against theory section 6.

The map is linear, so its columns are what one frame makes of each unit state. Delays are explicit delay lines here: no
datagram, no ramp. Order inside a frame: theory section 6.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from cogrip.client.virtual_coupling import VirtualCoupling
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings
from cogrip.protocol.messages import Stamp, State
from cogrip.protocol.settings import SeatSettings, resolve, seat_settings
from cogrip.server.worlds.grip import GripWorld
from cogrip.server.worlds.lagged import CoupledWorld, PaperWorld

USERS, TICKS, DEVICE_HZ = 2, 8, 1024
STIFFNESSES = (100, 500, 1000, 2000, 5000, 10000, 20000)
PAPER = {
    0: (1.0000, 1.0000, 1.0000, 1.0090, 2.7265, 6.1203, 13.0476),
    1: (1.0000, 1.0000, 1.0000, 1.2554, 3.1487, 6.4941, 13.3842),
    2: (1.0000, 1.0000, 1.0406, 1.4309, 3.1847, 6.5024, 13.3861),
    4: (1.0000, 1.0202, 1.0817, 1.5043, 3.1884, 6.5026, 13.3861),
}
COUPLED = {
    0: (1.0000, 1.0000, 1.0000, 1.0000),
    1: (1.0000, 1.0000, 1.0866, 1.3257),
    2: (1.0000, 1.0378, 1.1401, 1.2511),
    4: (1.0000, 1.0533, 1.0855, 1.1777),
}
STRUCTURAL = 4  # device positions x 2, joint translation, uniform motion

Array = NDArray[np.float64]
Frame = Callable[[Array], Array]


def seats(stiffness: float, **coupling: object) -> list[SeatSettings]:
    settings = resolve(
        {
            "coupling": {"stiffness_npm": stiffness, "damping_nspm": 10.0, "impedance_nspm": 20.0, **coupling},
            "object": {"mass_kg": 0.2, "damping_nspm": 0.0},
            "users": [{"name": "a"}, {"name": "b"}],
        }
    )
    return [seat_settings(settings, number) for number in range(USERS)]


def plant_at(position: float, velocity: float) -> IdealPlant:
    plant = IdealPlant(IdealSettings(mass_kg=0.1), 1)
    plant.open(DEVICE_HZ, 0.0, 0.0, (position,))
    plant.velocity_mps = [velocity]
    return plant


def run_ticks(client: WaveCoupling | VirtualCoupling, plant: IdealPlant) -> None:
    """M ticks in the order of `ClientCore`: the law from the tick's own velocity, the plant, the books."""
    for _ in range(TICKS):
        velocity, before = list(plant.velocity_mps), plant.position_m[0]
        plant.step((0.0,), client.force(plant.position_m, velocity))
        client.elapse([(plant.position_m[0] - before) * DEVICE_HZ], velocity)


def matrix(frame: Frame, size: int) -> Array:
    return np.array([frame(unit) for unit in np.eye(size)]).T


def wave_frame(these: list[SeatSettings], delay: int) -> tuple[Frame, int]:
    """State: x, v, filter [users x 3]; forward line [d x users]; returning line [d + 1 x users]; x_s or e; F; x_o, v_o."""
    paper = these[0].coupling.server_step == "paper"
    lowpass = these[0].coupling.decimator == "lowpass"
    ups, downs = delay * USERS, (delay + 1) * USERS
    size = 3 * USERS + ups + downs + 2 * USERS + 2

    def frame(state: Array) -> Array:
        parts = np.split(state, np.cumsum([3 * USERS, ups, downs, USERS, USERS]))
        devices, up, down = (
            parts[0].reshape(USERS, 3),
            list(parts[1].reshape(-1, USERS)),
            list(parts[2].reshape(-1, USERS)),
        )
        returning = down.pop(0)
        sent, after = [], []
        for seat, (position, velocity, filtered), wave in zip(these, devices, returning, strict=True):
            client, plant = WaveCoupling(seat), plant_at(position, velocity)
            client.returning = (float(wave),)
            if lowpass:
                client._decimator._state = [filtered]  # type: ignore[attr-defined]
            run_ticks(client, plant)
            (wave_sent,) = client._decimator.take()
            sent.append(wave_sent)
            after.append([plant.position_m[0], plant.velocity_mps[0], wave_sent if lowpass else 0.0])
        up.append(np.array(sent))
        world: GripWorld | PaperWorld = PaperWorld(these) if paper else GripWorld(these)
        world.stiffness, world.damping = world.target_stiffness.copy(), world.target_damping.copy()
        world.present[:] = True
        world.force = parts[4][:, None].copy()
        world.position, world.velocity = parts[5][:1].copy(), parts[5][1:].copy()
        if isinstance(world, PaperWorld):
            world.hand = parts[3][:, None].copy()
        else:
            world.stretch = parts[3][:, None].copy()
        down.append(world.step(up.pop(0)[:, None])[:, 0])
        reached = world.hand if isinstance(world, PaperWorld) else world.stretch
        force = world.force[:, 0] if paper else np.zeros(USERS)
        flat = [np.array(after).ravel(), *up, *down, reached[:, 0], force, world.position, world.velocity]
        return np.concatenate(flat)

    return frame, size


def coupled_frame(these: list[SeatSettings], delay: int) -> tuple[Frame, int]:
    """State: x, v [users x 2]; device states [d x users x 2]; object states as sent [d x users x 2]; x_o, v_o.

    Both ends work on what the other one was at the frame's start: the server steps first and answers with the state it
    stepped from, as it does at a frame border of the laboratory.
    """
    line = delay * USERS * 2
    size = 2 * USERS + 2 * line + 2

    def frame(state: Array) -> Array:
        parts = np.split(state, np.cumsum([2 * USERS, line, line]))
        devices = parts[0].reshape(USERS, 2)
        up, down = [*parts[1].reshape(-1, USERS, 2), devices], list(parts[2].reshape(-1, USERS, 2))
        world = CoupledWorld(these)
        for user in range(USERS):
            world.join(user, np.zeros(1))
        world.position, world.velocity = parts[3][:1].copy(), parts[3][1:].copy()
        down.append(world.step(up.pop(0)))
        after = []
        for seat, device, (position, velocity) in zip(these, devices.tolist(), down.pop(0).tolist(), strict=True):
            client, plant = VirtualCoupling(seat), plant_at(*device)
            client.receive(State(1, 0, (position,), (velocity,), 0.0, 0, Stamp(0)))
            client.start_frame()
            run_ticks(client, plant)
            after += [plant.position_m[0], plant.velocity_mps[0]]
        flat = [np.array(after), *(row.ravel() for row in (*up, *down)), world.position, world.velocity]
        return np.concatenate(flat)

    return frame, size


@cache
def eigenvalues(scheme: str, delay: int, stiffness: float) -> tuple[complex, ...]:
    if scheme == "paper":
        these = seats(stiffness, decimator="lowpass", lowpass_rad_s=50.0, server_step="paper", encoder="velocity")
    elif scheme == "coupled":
        these = seats(stiffness, kind="coupling")
    else:
        these = seats(stiffness, encoder=scheme)
    frame, size = (coupled_frame if scheme == "coupled" else wave_frame)(these, delay)
    return tuple(np.linalg.eigvals(matrix(frame, size)))


def largest(scheme: str, delay: int, stiffness: float) -> float:
    return max(abs(value) for value in eigenvalues(scheme, delay, stiffness))


def at_one(values: tuple[complex, ...]) -> int:
    """How many lie at 1, as near as a Jordan block (uniform motion) lets them be computed."""
    return sum(abs(value - 1.0) < 1e-5 for value in values)


@pytest.mark.parametrize("delay", PAPER)
def test_the_papers_scheme(delay: int) -> None:
    found = [round(largest("paper", delay, stiffness), 4) for stiffness in STIFFNESSES]
    assert found == list(PAPER[delay])


@pytest.mark.parametrize("delay", COUPLED)
def test_virtual_coupling(delay: int) -> None:
    found = [round(largest("coupled", delay, stiffness), 4) for stiffness in STIFFNESSES[:4]]
    assert found == list(COUPLED[delay])


def test_virtual_coupling_without_delay_ends_between_3000_and_4000() -> None:
    assert round(largest("coupled", 0, 3000.0), 4) == 1.0
    assert round(largest("coupled", 0, 4000.0), 4) == 1.1172


@pytest.mark.parametrize("encoder", ["displacement", "velocity"])
@pytest.mark.parametrize("delay", [0, 1, 2, 4])
def test_the_passive_scheme_at_any_delay_and_stiffness(delay: int, encoder: str) -> None:
    found = [round(largest(encoder, delay, stiffness), 4) for stiffness in (*STIFFNESSES, 1e5, 1e6)]
    assert found == [1.0] * len(found)


@pytest.mark.parametrize("scheme", ["displacement", "paper"])
@pytest.mark.parametrize("delay", [0, 4])
def test_structural_eigenvalues_lie_at_one(scheme: str, delay: int) -> None:
    """Where the scheme is stable nothing else lies there: the rest decays."""
    values = eigenvalues(scheme, delay, 100.0)
    assert at_one(values) == STRUCTURAL
    assert sorted(abs(value) for value in values)[-STRUCTURAL - 1] < 0.9999


@pytest.mark.parametrize("delay", [0, 1])
def test_virtual_coupling_brakes_uniform_motion(delay: int) -> None:
    """Old positions pull back: of the structural eigenvalues joint translation alone is left."""
    assert at_one(eigenvalues("coupled", delay, 500.0)) == 1
