"""An impedance that a client changes while it holds the object: its own port alone, within bounds, and no energy is made."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from cogrip.protocol.laws.waves import wave_of
from cogrip.protocol.settings.line_tuning import LEAST_NSPM, MOST_NSPM
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Stamp, Waves, decode, encode
from cogrip.server.ports.seat_limits import SeatLimits
from cogrip.server.ports.wave_port import WavePort
from cogrip.server.schemes import make_world
from cogrip.server.worlds.world import World
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.interpreted import needs_interpreted
from tests.kinds import OBJECTS
from tests.server.broken_worlds import Springs
from tests.server.scene_worlds import hold, port_j, world_of, world_of_settings
from tests.server.test_guarded_world import guarded

T = 1.0 / 128.0
F, V = 8.5, 2.0


def port(impedance: object = "auto", axes: int = 1) -> WavePort:
    table = {
        "coupling": {"impedance_nspm": impedance}, "object": {"axes": axes}, "playout": {"frames": 0, "redundancy": 1},
        "users": [{"name": "anna"}],
    }  # fmt: skip
    return WavePort(seat_settings(resolve(table), 0), SeatLimits(F, V))


def message(number: int, impedance_nspm: float, since: int, wave: float = 0.1) -> Waves:
    sums = (0.1 * number,), (0.01 * number,)
    return Waves(7, number, (wave,), *sums, 0.0, 0.0, 0, Stamp(1), (0.0, 0.0), 0, 0, impedance_nspm, since)


def step(at: WavePort, number: int, impedance_nspm: float, since: int, wave: float = 0.1) -> float:
    """Take a frame in, step, and return the wave that is let through."""
    assert at.receive(message(number, impedance_nspm, since, wave), 0)
    (row,) = at.pop(1)
    at.push((0.0,))
    return row


def told(at: WavePort) -> tuple[float, int]:
    answer = decode(at.message(7, MessageClock(), 1, (0.0, 0.0), 0.0))
    assert isinstance(answer, Waves)
    return answer.impedance_nspm, answer.since


def test_a_frame_is_read_with_its_own_impedance_and_the_answer_says_so() -> None:
    at = port()
    for number in range(4):
        step(at, number, 20.0, 0)
    assert (at.impedance_nspm, told(at)) == (20.0, (20.0, 0))
    step(at, 4, 10.0, 4)
    assert (at.impedance_nspm, told(at)) == (10.0, (10.0, 4))
    step(at, 5, 10.0, 4)
    assert told(at) == (10.0, 4)
    assert at.receive(message(7, 5.0, 6), 0)  # before frame 6, and of both
    at.pop(1)
    assert at.impedance_nspm == 5.0


@pytest.mark.parametrize("asked", [0.5, LEAST_NSPM, MOST_NSPM, MOST_NSPM + 1.0, 1e4])
def test_a_server_bounds_what_a_client_asks_for(asked: float) -> None:
    at = port()
    step(at, 0, asked, 0)
    assert at.impedance_nspm == min(max(asked, LEAST_NSPM), MOST_NSPM)


def test_a_seat_whose_settings_have_a_number_keeps_it() -> None:
    at = port(20.0)
    step(at, 0, 5.0, 0)
    assert (at.impedance_nspm, told(at)) == (None, (0.0, 0))


@pytest.mark.parametrize(("since", "fits"), [(0, True), (3, True), (4, False), (2**53, False)])
def test_a_change_later_than_the_newest_frame_is_unfit(since: int, fits: bool) -> None:
    assert port().receive(message(3, 5.0, since), 0) == fits


@pytest.mark.parametrize("b", [5.0, 20.0, 60.0])
def test_the_largest_wave_is_that_of_the_impedance_in_use(b: float) -> None:
    at, largest = port(), wave_of(b, V, F)
    step(at, 0, b, 0)
    assert step(at, 1, b, 0, largest * (1.0 - 1e-12)) == largest * (1.0 - 1e-12)
    assert step(at, 2, b, 0, 1.1 * largest) == pytest.approx(largest)
    assert at.limited == {"wave clipped": 1}


def driven(world: World, seed: int, frames: int = 200) -> float:
    """Return the least that was left of what came in, with impedances and waves at random."""
    random, balance, least, people = np.random.default_rng(seed), 0.0, 0.0, len(world.holding)
    start = world.energy_j
    for _ in range(frames):
        world.set_impedance(int(random.integers(people)), float(10.0 ** random.uniform(0.0, 1.78)))
        waves = random.uniform(-1.0, 1.0, (people, world.axes))
        balance += port_j(waves, np.array(world.advance([tuple(row) for row in waves.tolist()])))
        least = min(least, balance - (world.energy_j - start))
    return least


@pytest.mark.parametrize("kind", OBJECTS)
@pytest.mark.parametrize("people", [2, long(20)])
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_no_step_makes_energy_whatever_the_impedances_do(kind: str, people: int, seed: int) -> None:
    users = [{"name": f"u{number}", "side": ("left", "right")[number % 2]} for number in range(people)]
    table = resolve({"object": {"kind": kind}, "coupling": {"stiffness_npm": 5000.0}, "users": users})
    world = make_world([seat_settings(table, number) for number in range(people)])
    for user in range(people):
        world.join(user, np.zeros(1))
    assert driven(world, seed, 100) >= -1e-9
    assert world.balance_error_j < 1e-9


@pytest.mark.parametrize("scene", ["lift", "wall", "peg"])
def test_a_scene_gives_out_no_more_than_came_in(scene: str) -> None:
    """The damper of a tool changes with its port, so nothing has to be limited; with six axes b_r goes along."""
    world = hold(world_of_settings(scene) if scene == "peg" else world_of(scene))
    length = world.port_impedance / world.impedance
    assert driven(world, 1) >= -1e-3
    assert world.balance_error_j < 1e-9
    assert world.limiter.limited == 0
    np.testing.assert_allclose(world.port_impedance / world.impedance, length, rtol=1e-12)


def test_a_scene_with_the_old_damper_would_be_limited() -> None:
    """The test above can fail."""
    world = hold(world_of("lift"))
    world._damp = lambda user: None  # type: ignore[method-assign]
    driven(world, 1, 50)
    assert world.limiter.limited > 0


def test_a_world_of_another_author_hears_of_it() -> None:
    world = guarded(Springs)
    for user in range(2):
        world.join(user, np.zeros(2))
    assert driven(world, 3) >= -1e-3
    world.set_impedance(0, 7.0)
    assert world.inner.impedance[0, 0] == 7.0
    assert world.inner._drive[0, 0] == pytest.approx(np.sqrt(14.0))  # type: ignore[attr-defined]


@pytest.mark.long
@needs_interpreted
def test_a_client_that_lies_about_its_impedance_harms_its_own_line_alone() -> None:
    """Each frame says another b, and another beginning: the other person's ledgers and the object stay as they should."""
    users = [{"name": "mallory", "hand": "sine&amplitude_m=0.03"}, {"name": "ben", "hand": "sine&amplitude_m=0.02"}]
    laboratory = Laboratory(resolve({
        "seconds": 6.0, "link": {"profile": "wan"}, "coupling": {"impedance_nspm": "auto"}, "users": users,
    }))  # fmt: skip
    random, coupling = np.random.default_rng(5), laboratory.people[0].core.coupling
    honest = coupling.message

    def lie(*given: object) -> bytes:
        true = decode(honest(*given))
        assert isinstance(true, Waves)
        since = max(0, true.first + len(true.waves) - 1 - int(random.integers(4)))
        return encode(structs.replace(true, impedance_nspm=float(10.0 ** random.uniform(-3.0, 4.0)), since=since))

    coupling.message = lie
    seen = set()
    laboratory.run(each_frame=lambda laboratory: seen.add(float(laboratory.room.world.impedance[0, 0])))
    room, ben = laboratory.room, laboratory.people[1].core
    assert len(seen) > 40
    assert (min(seen), max(seen)) == (LEAST_NSPM, MOST_NSPM)
    assert (ben.unstable, ben.saturated, ben.left) == ("", "", "")
    assert (room.unstable, room.left) == ("", [])
    assert room.world.impedance[1, 0] == 20.0
    assert room.world.balance_error_j < 1e-9
    for seat in room.seats:
        assert seat.port is not None
        assert (seat.port.up_margin_j or 0.0) >= -1e-3
        assert seat.line_margin_j >= -2e-3
    assert ben.coupling.down_margin_j >= -1e-3
