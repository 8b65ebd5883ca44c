"""A server's core and clients in C around it, in virtual time: seeded loss and delay, simulated hands."""

from itertools import count, pairwise
from math import cos, pi
from random import Random
from typing import Any, TypeVar

from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.accounts import ClientAccount
from cogrip.protocol.wire.messages import Leave, decode, encode
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import ServerCore

from tests.clients.compiled import CClient

HZ, M = 1024, 8


Kind = TypeVar("Kind")
MASS_KG, SPRING_NPM, DAMPING_NSPM = 0.3, 200.0, 10.0


class Hand:
    """A mass that a spring pulls to and fro along the first axis."""

    def __init__(self, axes: int, stroke_m: float = 0.03) -> None:
        self.position_m, self.velocity_mps, self._stroke_m = [0.0] * axes, [0.0] * axes, stroke_m

    def move(self, time_s: float, force_n: tuple[float, ...]) -> tuple[float, ...]:
        for axis, place in enumerate(self.position_m):
            wanted = 0.0 if axis else self._stroke_m * (1.0 - cos(pi * time_s))
            hand_n = SPRING_NPM * (wanted - place) - DAMPING_NSPM * self.velocity_mps[axis]
            self.velocity_mps[axis] += (hand_n - force_n[axis]) / MASS_KG / HZ
            self.position_m[axis] += self.velocity_mps[axis] / HZ
        return tuple(self.position_m)


class VirtualSession:
    """One server and people who hold its object; Datagrams take `delay_ticks` at least; `loss` of them are lost.

    forces   of each person in each tick [N]
    sent     all datagrams of the clients
    """

    def __init__(
        self, library: Any, *names: str, seed: int = 0, delay_ticks: int = 3, jitter_ticks: int = 0, loss: float = 0.0,
        tickets: bool = True, config: dict[str, Any] | None = None, **settings: Any,
    ) -> None:  # fmt: skip
        users = [{"name": name, "side": side} for name, side in zip(names, ("left", "right"), strict=False)]
        self.settings = resolve({"name": "lab", "users": users, **settings})
        self._sessions, self._tickets, self._with_tickets = count(100), count(1), tickets
        self.core = self._new_core()
        axes = self.settings.object.axes
        self.people = [
            CClient(library, name=name.encode(), nonce=40 + number, axes=axes, **(config or {}))
            for number, name in enumerate(names)
        ]
        self.hands = [Hand(axes) for _ in names]
        self.forces: list[list[tuple[float, ...]]] = [[] for _ in names]
        self.sent: list[bytes] = []
        self.loss, self._silent, self.tick = loss, False, 0
        self._random, self._delay, self._jitter = Random(seed), delay_ticks, jitter_ticks
        self._flight: dict[int, list[tuple[int, bool, bytes]]] = {}
        for person in self.people:
            person.connect(0)

    def _new_core(self) -> ServerCore:
        services = AdmissionServices(
            lambda: next(self._sessions), new_ticket=lambda: f"t{next(self._tickets)}" if self._with_tickets else ""
        )
        return ServerCore([self.settings], "test", services)

    def restart(self) -> None:
        """Replace the server by a new one, which knows nothing."""
        self.core = self._new_core()

    @property
    def now_ns(self) -> int:
        return due_ns(10**9, self.tick, HZ)

    @property
    def person(self) -> CClient:
        """The first of the people."""
        return self.people[0]

    def messages(self, kind: type[Kind]) -> list[Kind]:
        """Return all that the clients sent of this kind."""
        return [message for message in map(decode, self.sent) if isinstance(message, kind)]

    def buttons(self) -> list[tuple[int, bool]]:
        """Return the list to which the world's button presses go from now on."""
        told: list[tuple[int, bool]] = []
        self.core.rooms[0].world.button = lambda user, button, down: told.append((button, down))  # type: ignore[method-assign]
        return told

    def _put(self, person: int, up: bool, datagram: bytes) -> None:
        if self._random.random() >= self.loss:
            arrival = self.tick + self._delay + self._random.randint(0, self._jitter)
            self._flight.setdefault(arrival, []).append((person, up, datagram))

    def _deliver(self) -> None:
        for person, up, datagram in self._flight.pop(self.tick, []):
            if not up:
                self.people[person].receive(datagram, self.now_ns)
            elif not self._silent:
                self.core.receive(datagram, str(person), self.now_ns)

    def run(self, seconds: float, *, skip: bool = False, absent: bool = False, silent: bool = False) -> None:
        """Let time pass. skip: the clients' loops miss it; absent: the devices give no samples; silent: the server is away."""
        self._silent = silent
        for _ in range(round(seconds * HZ)):
            self.step(skip, absent)
        self._silent = False

    def step(self, skip: bool = False, absent: bool = False) -> None:
        """Run one tick of everybody."""
        now_ns = self.now_ns
        self._deliver()
        for number, (person, hand) in enumerate(zip(self.people, self.hands, strict=True)):
            place = hand.move(self.tick / HZ, person.force_n)
            if skip:
                continue
            if person.status.axes:
                person.sense(self.tick, None if absent else place, now_ns)
                self.forces[number].append(person.act(now_ns))
            else:
                person.poll(now_ns)
            for datagram, _ in person.sent():
                self.sent.append(datagram)
                self._put(number, True, datagram)
        if self.tick % M == 0 and not self._silent:
            self.core.tick(self.core.rooms[0], now_ns)
        while self.core.outbox:
            address, datagram = self.core.outbox.popleft()
            if not self._silent:
                self._put(int(str(address)), False, datagram)
        self.tick += 1

    def leave(self, after_s: float = 0.0) -> ClientAccount:
        """Let everybody leave after some time, and wait until they have. Returns the account that came last."""
        self.run(after_s)
        for person in self.people:
            person.leave(self.now_ns)
        for _ in range(3 * HZ):
            if all(person.done for person in self.people):
                return self.account
            self.step()
        raise AssertionError([person.state for person in self.people])

    @property
    def account(self) -> ClientAccount:
        account = self.messages(Leave)[-1].account
        assert account
        return account

    def largest_step_n(self, person: int = 0) -> float:
        """Return the largest change of the force between two ticks."""
        forces = self.forces[person]
        return max(max(abs(b - a) for a, b in zip(before, after, strict=True)) for before, after in pairwise(forces))

    def sends_what_the_reference_would(self) -> bool:
        """Return whether the reference writes each datagram that was sent to the same bytes."""
        return all(encode(decode(datagram)) == datagram for datagram in self.sent)
