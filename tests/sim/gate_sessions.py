"""Random sessions of partners' models on their cores, some of whose people lie: what the hands together take out.

Real couplings, ports, world and links, in virtual time; the harness moves the hands and sums F (x_{k+1} - x_k) itself. With H
the honest people, N all, P power of a seat, E_0, p budget and refill of a gate:

    sum_H W_i(t) >= -sum_H (E_0 + p t_rest,i) - sum_liars (P (t + burst)) |H| / (N - 1) - sum_H 2 (most taken in a tick)

since a liar gives its partners what the server passes for it at most. Of a liar's own hand nothing is said: its motors are its.
"""

from collections.abc import Iterator
from math import inf
from random import Random
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.coupling.partner.spring_gate import BUDGET_J, REFILL_W, REST_MPS, REST_S
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.wire.clock import MessageClock
from cogrip.protocol.wire.messages import Partner, decode
from cogrip.server.ports.partner_port import PartnerPort
from cogrip.server.ports.seat_limits import BURST_S, SeatLimits
from cogrip.server.worlds.partners import PartnersWorld
from cogrip.sim.link import LinkEmulator

NETWORK_HZ, TICKS = 128, 8
TICK_S = 1.0 / (NETWORK_HZ * TICKS)
POWER_W = 2.0  # power of a seat: so little that a liar who passed it would be seen
MASS_KG = 0.1


class Outcome(NamedTuple):
    """taken_j: most that the honest hands together had taken out; budget_j: what they might, at that time.

    spare_j: least of budget, liars' power and the take of two ticks together less what was taken: below 0 the law is broken
    said_j, passed_j: most that all liars said to have given, and what of it the server passed
    """

    seed: int
    people: int
    liars: int
    taken_j: float
    budget_j: float
    spare_j: float
    said_j: float
    passed_j: float


class Hand:
    """A hand that intends anything, of any stiffness, and its device; some let go, some are thrown about."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self.wild = random.random() < 0.3
        self._stiffness_npm = random.choice((0.0, random.uniform(10.0, 1600.0)))
        self._damping_nspm = random.uniform(-3.0, 3.0)  # below 0 the hand gives way faster than it is pushed
        self._size_m, self._every_s = random.uniform(0.0, 0.08), random.choice((0.05, 0.3, 1.0, 5.0))
        self._intended_m = self.position_m = self.velocity_mps = 0.0

    def move(self, force_n: float) -> None:
        """Move by a tick under the force that is held."""
        random = self._random
        if random.random() < TICK_S / self._every_s:
            self._intended_m = random.uniform(-1.0, 1.0) * self._size_m
            if self.wild and random.random() < 0.3:
                self._stiffness_npm = random.choice((0.0, random.uniform(10.0, 1600.0)))
        pull = self._stiffness_npm * (self._intended_m - self.position_m)
        # The hand's damper is implicit: it is stable whatever its size.
        inertia = MASS_KG + TICK_S * self._damping_nspm
        self.velocity_mps = (MASS_KG * self.velocity_mps + TICK_S * (pull - force_n)) / inertia
        self.velocity_mps = max(-3.0, min(3.0, self.velocity_mps))
        self.position_m += TICK_S * self.velocity_mps
        if abs(self.position_m) > 0.2:
            self.position_m, self.velocity_mps = max(-0.2, min(0.2, self.position_m)), 0.0


class Person:
    """One person: hand, coupling, port, both directions of the link; what a liar sends is not what its coupling says."""

    def __init__(self, seat: SeatSettings, random: Random, link: LinkProfile, liar: bool) -> None:
        self.hand, self.coupling = Hand(random), PartnerCoupling(seat)
        self.port = PartnerPort(seat, SeatLimits(power_w=POWER_W))
        self.clocks = MessageClock(), MessageClock()  # of the client, of the server
        self.up, self.down = (LinkEmulator(link, f"{random.random()}") for _ in range(2))
        self.liar, self._random = liar, random
        self.force_n = self.work_j = self.most_j = self.refill_j = self.said_j = self.most_said_j = 0.0
        self._rested_s = 0.0

    def tick(self) -> None:
        """Move the hand under the force held, enter it, and ask for the next force."""
        hand, coupling, before = self.hand, self.coupling, self.hand.position_m
        hand.move(self.force_n)
        work = self.force_n * (hand.position_m - before)
        self.work_j += work
        self.most_j = max(self.most_j, -work)
        coupling.applied_n = (self.force_n,)
        mean = (hand.position_m - before) / TICK_S
        coupling.elapse((mean,), (hand.velocity_mps,))
        self._rested_s = self._rested_s + TICK_S if abs(hand.velocity_mps) < REST_MPS else 0.0
        self.refill_j += REFILL_W * TICK_S * (self._rested_s >= REST_S - TICK_S)
        (self.force_n,) = coupling.force((hand.position_m,), (hand.velocity_mps,))

    def send(self, now_ns: int) -> None:
        hand, coupling = self.hand, self.coupling
        coupling.end_frame()
        message = coupling.message(1, self.clocks[0], now_ns, (0.0,), (hand.position_m,), (hand.velocity_mps,))
        self.up.send(message, now_ns)
        coupling.start_frame()

    def told(self, datagram: bytes) -> Partner:
        """Return what reaches the server: of a liar anything that the wire lets pass."""
        message = decode(datagram)
        assert isinstance(message, Partner)
        if not self.liar or not message.intents:
            return message
        random, (intent,) = self._random, message.intents
        self.said_j = random.choice((0.0, self.said_j + random.uniform(0.0, 1.0), 1e6 * random.random(), 1e15))
        self.most_said_j = max(self.most_said_j, self.said_j)
        wild = replace(
            intent, donated_j=self.said_j, stiffness_npm=random.choice((0.0, 150.0, 1e4)),
            intention_m=(random.uniform(-0.3, 0.3),), rate_mps=(random.uniform(-5.0, 5.0),),
            made_ns=random.choice((intent.made_ns, 0, 2**62)),
        )  # fmt: skip
        return replace(message, intents=(wild,), port_j=random.uniform(-1e3, 1e3))


def outcome_of(seed: int, seconds: float = 2.0, people: int | None = None, liars: int | None = None) -> Outcome:
    """Run one random session: loss to 20 %, delay 0 to 600 ms, jitter, copies, 2 to 5 people; of whom a third lies at times."""
    random = Random(seed)
    number = people or random.randint(2, 5)
    lying = liars if liars is not None else random.choice((0, 0, *range(1, number)))
    settings = resolve({
        "coupling": {
            "kind": "partner", "stiffness_npm": random.choice((300.0, 1000.0, 3000.0)),
            "damping_nspm": random.uniform(0.0, 15.0),
        },
        "object": {"axes": 1, "mass_kg": random.uniform(0.05, 1.0)},
        "users": [{"name": f"p{each}"} for each in range(number)],
    })  # fmt: skip
    seats = [seat_settings(settings, each) for each in range(number)]
    world = PartnersWorld(seats)
    here = []
    for each, seat in enumerate(seats):
        link = LinkProfile(
            delay_ms=random.uniform(0.0, 600.0) ** random.choice((1.0, 0.5)), jitter_ms=random.choice((0.0, 30.0)),
            loss=random.uniform(0.0, 0.2), burst_frames=random.choice((1.0, 4.0)), duplicate=random.choice((0.0, 0.1)),
            reorder=random.choice((0.0, 0.1)),
        )  # fmt: skip
        here.append(Person(seat, random, link, each < lying))
        world.join(each, np.zeros(1))
    honest = here[lying:]
    taken_j, spare_j, budget_j = 0.0, inf, len(honest) * BUDGET_J
    for margin in _frames(here, world, round(seconds * NETWORK_HZ), honest):
        work_j, allowed_j, extra_j = margin
        if -work_j > taken_j:
            taken_j, budget_j = -work_j, allowed_j
        spare_j = min(spare_j, work_j + allowed_j + extra_j)
    passed_j = sum(person.port.used_j for person in here[:lying])
    said_j = sum(person.most_said_j for person in here[:lying])
    return Outcome(seed, number, lying, taken_j, budget_j, spare_j, said_j, passed_j)


def _frames(
    here: list[Person], world: PartnersWorld, frames: int, honest: list[Person]
) -> Iterator[tuple[float, float, float]]:
    """Run the session. Yield after each tick the honest hands' work, their budgets, and what may go beyond these [J]."""
    number, liars = len(here), len(here) - len(honest)
    for frame in range(frames):
        border_ns = round(1e9 * frame / NETWORK_HZ)
        for person in here:
            person.send(border_ns)
            for datagram in person.up.due(border_ns):
                told = person.told(datagram)
                person.clocks[1].read(told.stamp, border_ns)
                person.port.receive(told, border_ns)
            person.port.next_step_ns = round(1e9 * (frame + 1) / NETWORK_HZ)
        answers = world.advance([person.port.pop(1) for person in here])
        for person, answer in zip(here, answers, strict=True):
            person.port.push(tuple(answer))
            person.down.send(person.port.message(1, person.clocks[1], border_ns, (0.0,) * 2, 0.0), border_ns)
        for tick in range(TICKS):
            now_ns = border_ns + round(1e9 * tick * TICK_S)
            for person in here:
                for datagram in person.down.due(now_ns):
                    message = decode(datagram)
                    assert isinstance(message, Partner)
                    person.clocks[0].read(message.stamp, now_ns)
                    person.coupling.receive(message)
                person.tick()
            time_s = (frame * TICKS + tick + 1) * TICK_S
            given_j = liars * POWER_W * (time_s + BURST_S + 1.0 / NETWORK_HZ) * len(honest) / max(1, number - 1)
            yield (
                sum(person.work_j for person in honest),
                sum(BUDGET_J + person.refill_j for person in honest),
                given_j + 2.0 * sum(person.most_j for person in honest),
            )
