"""Models of partners in the client in C: the laws of the reference, and whole sessions of hands that hold one object."""

from ctypes import c_double, create_string_buffer
from itertools import pairwise
from math import inf
from random import Random
from typing import Any

import msgpack
import pytest

from cogrip.client.coupling.partner.hand_stiffness import HAND_NPM
from cogrip.client.coupling.partner.intention import Intention
from cogrip.client.coupling.partner.spring_gate import BUDGET_J, SpringGate
from cogrip.protocol.laws.partner_model import Model, step_object
from cogrip.protocol.wire.messages import Partner, encode

from tests.clients.compiled import AXES, CClient, needs_compiler
from tests.clients.test_c_messages import SESSION, fields
from tests.clients.virtual_session import DAMPING_NSPM, HZ, SPRING_NPM, Hand, VirtualSession
from tests.extent import every, long
from tests.protocol.test_spec_vectors import VECTORS, with_value

pytestmark = needs_compiler

TICK_S, DEVICE_KG = 1.0 / HZ, 0.1
K, B = 1000.0, 10.0
MOST_STEP_N = 0.5
EXACT = {"rel": 1e-9, "abs": 1e-12}


def row(numbers: Any) -> Any:
    return (c_double * len(numbers))(*numbers)


# Messages


def test_it_reads_and_writes_the_vector(library: Any) -> None:
    datagram, elements = VECTORS["partner"]
    whole, found = msgpack.unpackb(datagram), fields(library, datagram)
    assert [found["session"], found["number"], found["acknowledged"], found["port_j"]] == [
        whole[1],
        whole[2],
        whole[6],
        whole[10],
    ]
    assert (found["rows"], found["intent"], found["count"]) == ([whole[3][0], whole[4][0]], whole[5][0], 1)
    out = create_string_buffer(1195)
    size = library.probe_partner(SESSION, out)
    assert out.raw[:size] == datagram
    assert elements


@pytest.mark.parametrize(("intents", "allowed"), [(0, True), (7, True), (8, False)])
def test_as_many_intents_as_the_page_allows(library: Any, intents: int, allowed: bool) -> None:
    one = msgpack.unpackb(VECTORS["partner"][0])[5][0]
    datagram = with_value("partner", [5], [one] * intents)
    assert bool(library.probe_decode(datagram, len(datagram))) is allowed


def test_a_kind_that_it_has_not_is_read_and_refused_by_its_name(library: Any) -> None:
    """A scheme that is added later needs nothing here."""
    client = CClient(library, room=b"lab", name=b"anna", nonce=msgpack.unpackb(VECTORS["welcome"][0])[2])
    client.connect(0)
    client.receive(with_value("welcome", [6, 6, "kind"], "soon"), 1)
    assert client.state == "closed"
    assert client.reason == 'the seat\'s coupling.kind is "soon", which this client has not: take "wave" or "partner"'


# Laws


@pytest.mark.parametrize("seed", every(3, range(10)))
def test_its_gate_is_that_of_the_reference(library: Any, seed: int) -> None:
    random, axes = Random(seed), 1 + seed % AXES
    gate = SpringGate(TICK_S)
    library.probe_gate_begin(TICK_S)
    place, force = [0.0] * axes, [0.0] * axes
    below = donated = 0
    for _ in range(4000):
        speed = [random.uniform(-1.0, 1.0) * random.choice((0.0, 0.005, 1.0)) for _ in place]
        work = sum(f * v for f, v in zip(force, speed, strict=True)) * TICK_S
        credit = random.choice((0.0, 0.0, random.uniform(0.0, 1e-4)))
        place = [max(-0.05, min(0.05, at + v * TICK_S)) for at, v in zip(place, speed, strict=True)]
        stretch = [at * random.uniform(0.8, 1.2) for at in place]
        damper = [random.uniform(-3.0, 3.0) for _ in place]
        gate.work.add(work)
        gate.credit(credit)
        stretched, damped, state = row(stretch), row(damper), row([0.0] * 4)
        found = library.probe_gate_tick(axes, work, credit, stretched, K, damped, row(speed), B, state)
        part = gate.cut(stretch, K)
        stretch = [part * each for each in stretch]
        paid = gate.pay(stretch, K, damper, speed, B)
        assert found == pytest.approx(part, **EXACT)
        assert list(damped) == pytest.approx(list(paid), **EXACT)
        assert list(state) == pytest.approx([gate.budget_j, gate.donated_j, gate.refilled_j, gate.spilt_j], **EXACT)
        below += gate.budget_j < 0.0
        donated += gate.donated_j > 0.0
        force = [K * each + more for each, more in zip(stretch, paid, strict=True)]
    assert below or donated


def test_its_intention_is_that_of_the_reference_for_a_hand_of_known_stiffness(library: Any) -> None:
    random, own = Random(1), Intention(AXES, TICK_S, DEVICE_KG)
    place, out = [0.01, -0.02, 0.0], row([0.0] * 2 * AXES)
    own.begin(place)
    for tick in range(2000):
        speed = [random.uniform(-2.0, 2.0) for _ in place]
        force = [random.uniform(-5.0, 5.0) for _ in place]
        place = [at + v * TICK_S for at, v in zip(place, speed, strict=True)] if tick else place
        own.update(place, speed, force, HAND_NPM)
        library.probe_intention(int(not tick), AXES, row(place), row(speed), row(force), DEVICE_KG, TICK_S, out)
        assert list(out) == pytest.approx([*own.place_m, *own.rate_mps], **EXACT)


@pytest.mark.parametrize("count", [0, 1, 4])
def test_its_copy_is_that_of_the_reference(library: Any, count: int) -> None:
    random = Random(count)
    models = [Model([0.01 * each]) for each in range(count)]
    motion, numbers = row([0.0, 0.0]), row([0.2, 0.3, K, B, TICK_S])
    place, speed = [0.0], [0.0]
    table = row([0.0] * max(1, 5 * count))
    for _ in range(1000):
        own = (random.uniform(-0.03, 0.03), random.uniform(-0.5, 0.5))
        for number, model in enumerate(models):
            model.intention_m, model.stiffness_npm = [random.uniform(-0.05, 0.05)], random.choice((0.0, 60.0, 400.0))
            model.drift_mps = [random.uniform(-0.5, 0.5)]
            table[5 * number : 5 * number + 5] = [
                model.place_m[0], model.velocity_mps[0], model.intention_m[0], model.stiffness_npm, model.drift_mps[0],
            ]  # fmt: skip
        step_object(TICK_S, place, speed, 0.2, 0.3, (K, B), models, ([own[0]], [own[1]]))
        library.probe_step_copy(motion, numbers, row(own), count, table)
        assert list(motion) == pytest.approx([*place, *speed], **EXACT)
        for number, model in enumerate(models):
            assert list(table[5 * number : 5 * number + 2]) == pytest.approx(
                [model.place_m[0], model.velocity_mps[0]], **EXACT
            )


# Sessions


class Still(Hand):
    """A hand that rests until all are seated, goes to a place within 0.5 s and stays."""

    def __init__(self, axes: int, goal_m: float) -> None:
        super().__init__(axes)
        self._goal_m = goal_m

    def move(self, time_s: float, force_n: tuple[float, ...]) -> tuple[float, ...]:
        share = min(1.0, max(0.0, 2.0 * (time_s - 1.0)))
        for axis, place in enumerate(self.position_m):
            wanted = 0.0 if axis else self._goal_m * share * share * (3.0 - 2.0 * share)
            hand_n = SPRING_NPM * (wanted - place) - DAMPING_NSPM * self.velocity_mps[axis]
            self.velocity_mps[axis] += (hand_n - force_n[axis]) / 0.3 / HZ
            self.position_m[axis] += self.velocity_mps[axis] / HZ
        return tuple(self.position_m)


class Held(VirtualSession):
    """People who hold a cube through partners' models; it sums the work of each hand."""

    def __init__(self, library: Any, *goals_m: float, axes: int = 1, delay_ticks: int = 50, **network: Any) -> None:
        names = ("anna", "ben")[: len(goals_m)]
        coupling = {"kind": "partner", "stiffness_npm": K, "damping_nspm": B}
        super().__init__(
            library, *names, delay_ticks=delay_ticks, object={"axes": axes, "mass_kg": 0.2}, coupling=coupling,
            config={"apparent_mass_kg": 0.3}, **network,
        )  # fmt: skip
        self._library = library
        self.hands = [Still(axes, goal) for goal in goals_m]
        self.work_j, self.least_j = [0.0] * len(goals_m), 0.0

    def step(self, skip: bool = False, absent: bool = False) -> None:
        before = [
            (tuple(hand.position_m), person.force_n) for hand, person in zip(self.hands, self.people, strict=True)
        ]
        super().step(skip, absent)
        for number, ((place, force), hand) in enumerate(zip(before, self.hands, strict=True)):
            moved = (after - at for at, after in zip(place, hand.position_m, strict=True))
            self.work_j[number] += sum(f * step for f, step in zip(force, moved, strict=False))
        self.least_j = min(self.least_j, sum(self.work_j))

    def gates(self) -> list[tuple[float, ...]]:
        """Return W, Don, Cred and Refill of each."""
        found = []
        for person in self.people:
            into = row([0.0] * 4)
            self._library.probe_gate_of(person._client, into)
            found.append(tuple(into))
        return found


@pytest.mark.parametrize("delay_ticks", [5, 104, long(208)])
@pytest.mark.parametrize("axes", [1, 3])
def test_a_partner_at_rest_is_as_stiff_as_without_a_network(library: Any, delay_ticks: int, axes: int) -> None:
    session = Held(library, 0.03, 0.0, axes=axes, delay_ticks=delay_ticks)
    session.run(5.0)
    anna, status = session.person, session.person.status
    assert anna.force_n[0] / status.position_m[0] == pytest.approx(1.0 / (2.0 / K + 1.0 / SPRING_NPM), rel=0.03)
    assert session.largest_step_n() <= MOST_STEP_N
    assert status.object_m[0] == pytest.approx(session.core.rooms[0].world.position[0], abs=1e-4)


@pytest.mark.parametrize(("loss", "jitter_ticks"), [(0.0, 0), long(0.2, 30)])
def test_the_hands_take_no_more_than_their_budgets(library: Any, loss: float, jitter_ticks: int) -> None:
    session = Held(library, 0.03, -0.03, loss=loss, jitter_ticks=jitter_ticks)
    session.leave(3.0)
    gates = session.gates()
    assert session.least_j >= -sum(BUDGET_J + gate[3] for gate in gates) - 1e-4
    assert sum(gate[2] for gate in gates) <= sum(gate[1] for gate in gates) + 1e-12
    for gate, work_j in zip(gates, session.work_j, strict=True):
        assert gate[0] == pytest.approx(work_j, abs=1e-3), "what the gate knows is the work of the hand"
    for person in session.people:
        assert person.status.down_margin_j >= -BUDGET_J - 1e-4
        assert person.status.device_margin_j >= 0.0
        assert person.reason == ""
        assert person.status.down.applied > 100
    assert session.core.dropped["unfit"] == session.core.dropped["malformed"] == 0
    assert session.sends_what_the_reference_would()
    account = session.account
    assert (account.playout, account.line) == (None, None)


def test_who_falls_silent_comes_back_to_the_same_gate_and_force(library: Any) -> None:
    session = Held(library, 0.03, -0.03)
    session.run(3.0)
    felt = session.person.force_n[0]
    assert abs(felt) > 3.0
    session.run(0.9, silent=True)
    session.run(3.0)
    for number, person in enumerate(session.people):
        assert (person.state, person.safety, person.counts["resumed"]) == ("seated", "live", 1)
        assert session.largest_step_n(number) <= MOST_STEP_N
    assert session.person.force_n[0] == pytest.approx(felt, rel=0.05)


@pytest.mark.parametrize("away_s", [0.2, 0.9])
def test_a_server_that_knows_nothing_any_more_steps_nobody_and_lends_nobody_more(library: Any, away_s: float) -> None:
    """Each hand has the object where it is then; gates go on, so that all lines have one budget."""
    session = Held(library, 0.03, -0.03)
    session.run(3.0)
    before = session.gates()
    session.run(away_s, silent=True)
    session.restart()
    session.run(3.0)
    for number, person in enumerate(session.people):
        assert (person.state, person.safety) == ("seated", "live")
        assert person.counts["line begun anew"] == 1
        assert session.largest_step_n(number) <= MOST_STEP_N
        assert session.gates()[number][3] >= before[number][3]
    session.leave()
    assert session.least_j >= -sum(BUDGET_J + gate[3] for gate in session.gates()) - 1e-4


def test_a_partner_who_leaves_fades_without_a_step(library: Any) -> None:
    session = Held(library, 0.03, -0.03)
    session.run(3.0)
    session.people[1].leave(session.now_ns)
    session.run(2.0)
    assert abs(session.person.force_n[0]) < 0.2
    assert session.person.safety == "live"
    assert session.largest_step_n() <= MOST_STEP_N
    assert all(abs(b) < inf for a, b in pairwise(force[0] for force in session.forces[0]))


def test_a_fault_tells_no_intention_and_comes_back_with_a_ramp(library: Any) -> None:
    session = Held(library, 0.03, -0.03)
    session.run(2.0)
    session.run(0.05, absent=True)
    session.run(0.3)
    told = session.messages(Partner)
    assert session.person.safety == "fault"
    assert not told[-1].intents
    for person in session.people:
        person.rearm()
    session.run(2.0)
    assert session.messages(Partner)[-1].intents
    assert session.largest_step_n() <= 1000.0 / HZ + 1e-9


def test_waves_do_not_fit_a_seat_with_partners_models(library: Any) -> None:
    session = Held(library, 0.01, 0.0)
    session.run(0.5)
    number, stamp = session.messages(Partner)[0].session, session.messages(Partner)[0].stamp
    wide = Partner(number, 900, (0.0, 0.0), (0.0, 0.0), (), 0, stamp)
    for datagram in (with_value("waves from a server", [1], number), encode(wide)):
        session.person.receive(datagram, session.now_ns)
    assert session.person.counts["unfit"] == 2
