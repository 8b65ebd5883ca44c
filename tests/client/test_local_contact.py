"""Contact that the client renders itself: the wall's energy gate, and the copy of a free object's mass."""

import itertools
from math import sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.coupling.local.contact_spring import LENT_J, MOST_SAVED_J, MOST_STEP_N
from cogrip.client.coupling.local.local_contact import LocalCoupling
from cogrip.client.coupling.schemes import make_local
from cogrip.client.hand.velocity import largest_impedance
from cogrip.protocol.line.sender import LineSender
from cogrip.protocol.settings.seat import SeatSettings

from tests.client.seated_client import T_C, capability, next_waves, seat

b, K, B = 20.0, 1000.0, 10.0


def seat_of(kind: str, side: str = "left", **coupling: object) -> SeatSettings:
    other = "right" if side == "left" else "left"
    return seat(
        object={"kind": kind, "mass_kg": 0.3},
        coupling={"kind": "local", "impedance_nspm": b, "stiffness_npm": K, "damping_nspm": B, **coupling},
        playout={"frames": 0},
        users=[{"name": "anna", "side": side}, {"name": "ben", "side": other}],
    )


def send(coupling: LocalCoupling, line: LineSender, wave: float, object_m: float, speed_mps: float = 0.0) -> None:
    """Let a frame of the server arrive, with this wave and the object here."""
    assert coupling.receive(next_waves(line, wave, state=(object_m, speed_mps)))


class Hand:
    """A hand that is moved from place to place, a tick each, and feels the law's force. work_j: its own so far."""

    def __init__(self, coupling: LocalCoupling, place_m: float) -> None:
        coupling.fit(capability(), 0.0)
        self.coupling, self.place, self.work_j = coupling, place_m, 0.0
        self.force = coupling.force((place_m,), (0.0,))

    def move(self, place_m: float, ticks: int = 1) -> float:
        """Move within a tick, and stay there for the rest of so many. Returns the force from then on."""
        for _ in range(ticks):
            speed = (place_m - self.place) / T_C
            self.coupling.applied_n = self.force
            self.work_j += self.force[0] * (place_m - self.place)
            self.coupling.elapse((speed,), (speed,))
            self.place = place_m
            self.force = self.coupling.force((place_m,), (speed,))
        return self.force[0]


def largest_step(forces: list[float]) -> float:
    return max(abs(after - before) for before, after in itertools.pairwise(forces))


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_wall_pushes_back_by_its_spring_and_damper_and_only_inside(side: str, sign: float) -> None:
    hand = Hand(make_local(seat_of("wall", side)), -0.01 * sign)
    assert hand.move(-0.001 * sign) == 0.0
    assert hand.move(0.0005 * sign) == pytest.approx(sign * (K * 0.0005 + B * 0.0015 / T_C))
    assert hand.move(0.0005 * sign) == pytest.approx(sign * K * 0.0005)
    assert hand.move(0.0001 * sign) == 0.0  # it does not pull: the damper alone would
    assert hand.move(-0.0001 * sign) == 0.0


def test_hand_that_begins_inside_feels_nothing_until_it_has_left() -> None:
    hand = Hand(make_local(seat_of("wall")), 0.01)
    assert hand.force[0] == 0.0
    assert [hand.move(0.01) for _ in range(50)] == [0.0] * 50
    assert hand.move(0.004, 2) == 0.0
    hand.move(-0.001)
    assert hand.move(0.003, 2) == pytest.approx(3.0)


def test_wall_that_jumps_into_a_resting_hand_spends_what_the_contact_has_dissipated_and_no_more() -> None:
    coupling, line = make_local(seat_of("wall")), LineSender(1, 8)
    hand = Hand(coupling, -0.001)
    for tick in range(100):
        hand.move(-0.001 + 0.00006 * tick)
    before, saved = hand.move(hand.place, 20), coupling.contact.spring.gate.saved_j
    assert 0.0 < saved <= MOST_SAVED_J
    send(coupling, line, 0.0, -0.02)
    coupling.start_frame()
    felt = [before, *[hand.move(hand.place) for _ in range(500)]]
    assert largest_step(felt) <= MOST_STEP_N * (1 + 1e-9)
    assert felt[-1] > before
    assert (felt[-1] ** 2 - before**2) / (2.0 * K) == pytest.approx(saved, rel=1e-6)  # what the spring holds now more
    for tick in range(500):  # the wall follows a hand that yields, without pushing it
        hand.move(hand.place - 0.0001 * (tick % 10 == 0) * (hand.place > -0.0201))
    assert hand.work_j >= -1e-12
    while hand.place > -0.03:
        hand.move(hand.place - 0.0002)
    assert hand.move(-0.019, 2) == pytest.approx(1.0)  # and is where it is, for one that comes back


def test_wall_that_leaves_lets_go_step_by_step() -> None:
    coupling, line = make_local(seat_of("wall")), LineSender(1, 8)
    hand = Hand(coupling, -0.001)
    felt = [hand.move(0.003, 2)]
    send(coupling, line, 0.0, 0.05)
    felt += [hand.move(0.003) for _ in range(50)]
    assert (felt[0], felt[-1]) == (pytest.approx(3.0), 0.0)
    assert largest_step(felt) <= MOST_STEP_N * (1 + 1e-9)
    assert coupling.contact.surface_m == 0.05


def test_spring_comes_down_with_its_damper() -> None:
    """The device port takes from both of a contact: a spring that stays while its damper goes rings more."""
    coupling = make_local(seat_of("wall"))
    hand = Hand(coupling, -0.001)
    record_nspm = largest_impedance(capability(), T_C).impedance_nspm
    whole = hand.move(0.002, 2)
    for share in (1.0, 0.5, 0.1, 0.02):
        coupling.carried_nspm = share * B
        assert hand.move(0.002) == pytest.approx(share * whole)
        watched = record_nspm / coupling.carried_nspm * coupling.local_n[0]
        assert watched == pytest.approx(whole), "the port watches the contact as it would be with all of both"
    coupling.carried_nspm = record_nspm
    assert hand.move(0.002) == pytest.approx(whole)


def test_surface_yields_where_the_motors_cannot_follow_the_law() -> None:
    """Forces that rise by a slope go on to rise as the hand is pushed out, where the surface stays: the hand is thrown."""
    slope_n, stiffness, mass_kg, push_n = 1000.0 * T_C, 8847.0, 0.1, 6.0
    coupling = make_local(seat_of("wall", stiffness_npm=stiffness, damping_nspm=7.2))
    hand = Hand(coupling, 0.0)
    speed, place, force = 0.0, 0.0, 0.0
    speeds: list[float] = []
    for _ in range(200):
        accelerated = speed + (push_n - force) / mass_kg * T_C
        place, speed = place + 0.5 * (speed + accelerated) * T_C, accelerated
        law = hand.move(place)
        force = min(max(law, force - slope_n), force + slope_n)
        hand.force = [force]
        speeds.append(abs(speed))
    assert max(speeds[100:]) < 0.5
    assert -0.001 < place < 0.01


def test_surface_stays_where_motors_round_the_force() -> None:
    coupling = make_local(seat_of("wall"))
    hand = Hand(coupling, -0.001)
    for k in range(300):
        hand.force = [round(hand.force[0], 1)]  # as a driver's converter does
        hand.move(-0.001 + 0.003 * min(1.0, k / 60))
        assert coupling.contact.surface_m == 0.0
    assert hand.force[0] == pytest.approx(2.0)


paths = st.lists(
    st.tuples(st.floats(-0.0004, 0.0004), st.none() | st.floats(-0.02, 0.02), st.floats(0.0, 1.0)), max_size=300
)


@given(path=paths, stiffness=st.floats(10.0, 4000.0), damping=st.floats(0.0, 25.0))
def test_a_wall_that_moves_is_paid_for(
    path: list[tuple[float, float | None, float]], stiffness: float, damping: float
) -> None:
    coupling, line = make_local(seat_of("wall", stiffness_npm=stiffness, damping_nspm=damping)), LineSender(1, 8)
    hand, work = Hand(coupling, -0.001), 0.0
    for step, jump, ramp in path:
        coupling.ramp_gain = ramp
        if jump is not None:
            send(coupling, line, 0.0, jump)
        coupling.applied_n = [ramp * force for force in hand.force]
        work += coupling.applied_n[0] * step
        coupling.elapse((step / T_C,), (step / T_C,))
        hand.place += step
        before = coupling.contact.surface_m
        hand.force = coupling.force((hand.place,), (step / T_C,))
        after = coupling.contact.surface_m
        assert before is not None
        assert after is not None
        depth, earlier = (max(0.0, hand.place - surface) for surface in (after, before))
        if depth > earlier + 1e-12:  # the wall has moved into the hand
            assert coupling.contact.spring.gate.saved_j >= -1e-12
            assert stiffness * (depth - earlier) <= MOST_STEP_N * (1.0 + 1e-9)
        stored = coupling.stored_j
        assert (
            coupling.contact.spring.gate.saved_j + stored <= work + 1e-12
        )  # what is stored and saved is the hand's own work
        if ramp < 1.0:
            assert coupling.contact.spring.gate.saved_j >= -LENT_J - 1e-12 or stored <= 1e-12
        assert coupling.contact.spring.gate.saved_j <= MOST_SAVED_J


@given(
    steps=st.lists(st.tuples(st.floats(-0.0004, 0.0004), st.floats(-0.5, 0.5)), min_size=1, max_size=200),
    mass=st.floats(0.001, 1.0),
)
def test_copy_gives_the_line_what_the_contact_gave_it_less_its_kinetic_energy(
    steps: list[tuple[float, float]], mass: float
) -> None:
    coupling, line = make_local(seat_of("faces")), LineSender(1, 8)
    coupling.contact._mass = mass
    send(coupling, line, 0.0, 0.0)
    coupling.start_frame()
    hand = Hand(coupling, 0.0)
    worked = lined = speed = 0.0
    for tick, (step, wave) in enumerate(steps, 1):
        if tick % 8 == 0:
            coupling.end_frame()
            send(coupling, line, wave, 0.0)
            coupling.start_frame()
        v, force, before = coupling.returning[0], hand.force[0], coupling.contact.surface_m
        hand.move(hand.place + step)
        middle = (coupling.forward[0] + v) / sqrt(2.0 * b)  # the line's port: y = (u + v) / sqrt(2b)
        worked += force * middle * T_C
        lined += 0.5 * (coupling.forward[0] ** 2 - v * v) * T_C
        speed = 2.0 * middle - speed
        assert before is not None
        assert 0.5 * mass * speed * speed == pytest.approx(worked - lined, abs=1e-12 + 1e-9 * abs(worked))


def test_seats_share_the_mass_of_a_free_object_with_the_server() -> None:
    assert seat_of("faces").copy_kg == pytest.approx(0.1)
    assert seat_of("wall").copy_kg == 0.0


def test_face_that_nobody_touches_goes_to_where_the_object_is() -> None:
    coupling, line = make_local(seat_of("faces")), LineSender(1, 8)
    send(coupling, line, 0.0, 0.0)
    hand = Hand(coupling, -0.05)
    send(coupling, line, 0.0, 0.01)
    hand.move(-0.05, 512)
    assert coupling.contact.surface_m == pytest.approx(0.01, abs=1e-5)
    send(coupling, line, 0.0, -0.08)
    hand.move(-0.05, 512)
    assert coupling.contact.surface_m == -0.05  # up to the hand, not into it
    assert hand.force[0] == 0.0
