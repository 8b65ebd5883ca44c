"""The front of several workers: who comes while they start, and many people who come by one link."""

import os
import socket
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from types import SimpleNamespace

import msgspec
import pytest

from cogrip.machine.server_platform import message_pair
from cogrip.machine.stop import Stop
from cogrip.protocol.secure.channel import Address, UnencryptedChannel
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import PROTOCOL_VERSION, Hello, Welcome, padded
from cogrip.protocol.wire.session import refusal
from cogrip.server.admission.admission import Grant
from cogrip.server.events import ServerEvent
from cogrip.server.hosting import public_socket
from cogrip.server.hosting.link import (
    Ask,
    Assign,
    Astray,
    Forget,
    Path,
    ProcessLink,
    Ready,
    Released,
    RoomOnDemand,
    Say,
    Stray,
    ToFront,
    ToWorker,
)
from cogrip.server.hosting.workers.front import ASKED_NS, Front
from cogrip.server.hosting.workers.pool import Worker, WorkerPool
from cogrip.server.hosting.workers.steering import Steering, open_public

from tests.protocol.two_ends import SETTINGS, hello

HOST = "127.0.0.1"
LIMIT_S = 60.0
CLOCKS_NS = 1_000_000_000  # by which two clocks may be read apart on a busy machine
ROOMS = [msgspec.structs.replace(SETTINGS, name=name) for name in ("attic", "cellar")]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="several workers need Linux")


class Heard(UnencryptedChannel):
    """A channel that lets everything through. heard: called after each datagram that has come."""

    def __init__(self) -> None:
        super().__init__()
        self.renewed: deque[Address] = deque()
        self.events: deque[ServerEvent] = deque()
        self.heard: Callable[[], None] = lambda: None

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Sequence[bytes]:
        self.heard()
        return (datagram,)


class OneToken:
    """Admits everybody as the holder of one token."""

    def admit(self, given: Hello) -> Grant:
        return Grant(given.role, "0b9ee21b")

    def shown(self, given: Hello) -> str:
        return "0b9ee21b"

    def admitted(self, grant: Grant) -> None: ...


class Fronted:
    """A front of two rooms whose workers are the test itself: `ends` are their ends of the links, by number."""

    def __init__(self, steers: bool = False) -> None:
        self.public = open_public(HOST, 0)
        self._sockets = ExitStack()
        self.steering = Steering(self.public, 2, self._sockets) if steers else None
        self.person = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ends: dict[int, ProcessLink] = {}
        self.stop, self.channel = Stop(), Heard()
        own = [each.fileno() for each in self.steering.own] if self.steering else []
        self.pool = WorkerPool([("attic",), ("cellar",)], lambda number, end: None, fresh=False, own=own)  # type: ignore[arg-type, return-value]
        self.pool.add = self._add  # type: ignore[method-assign]
        self.pool.begin()
        self.front = Front(
            self.public, ROOMS, self.pool, self.stop, lambda event: None, lambda asks: self.channel, OneToken(),
            self.steering,
        )  # type: ignore[arg-type] # fmt: skip

    def _add(self) -> Worker:
        ours, theirs = message_pair()
        number = len(self.ends) + 1
        self.ends[number] = ProcessLink(theirs)
        self.pool.workers.append(Worker(number, SimpleNamespace(pid=number), ProcessLink(ours)))  # type: ignore[arg-type]
        return self.pool.workers[-1]

    def ask(self, room: str, name: str = "anna") -> bytes:
        """Return a hello for a room."""
        return padded(msgspec.structs.replace(hello(name), room=room))

    def asked(self, number: int) -> list[tuple[str | int, ...]]:
        """Return the addresses about which a worker was asked since the last call, in their order."""
        found = []
        with suppress(BlockingIOError):
            while True:
                given, _ = self.ends[number].take_at_worker()
                if isinstance(given, Ask):
                    found.append(given.address)
        return found

    def close(self) -> None:
        for each in (self.public, self.person, *self.ends.values(), *(worker.link for worker in self.pool.workers)):
            each.close()
        self._sockets.close()


@pytest.fixture
def fronted() -> Iterator[Fronted]:
    with closing(Fronted()) as made:
        yield made


def test_a_room_on_demand_that_a_new_worker_does_not_have_is_closed(fronted: Fronted) -> None:
    """Its worker was killed before there was a checkpoint: else its name would be taken for ever, and its links good."""
    front, pool, revoked = fronted.front, fronted.pool, list[str]()
    front._templates, front.revoke_room = {"lesson": SETTINGS}, revoked.append
    killed = pool.workers[0]
    for called in ("one", "two"):
        front._follow(killed, RoomOnDemand(called, "lesson", True))
    pool.workers[0] = after = Worker(9, SimpleNamespace(pid=9), killed.link, killed.rooms, killed.group)  # type: ignore[arg-type]
    front._follow(after, RoomOnDemand("two", "lesson", True))
    front._follow(after, Ready())
    assert (list(front.opened), list(pool.opened), revoked) == (["two"], ["two"], ["one"])
    assert pool.home("two") is after
    assert pool.home("one") is None


def test_a_room_is_served_while_another_worker_still_starts_and_the_spare_comes_last(fronted: Fronted) -> None:
    fronted.person.bind((HOST, 0))
    fronted.ends[1].send(Ready())
    early: list[tuple[str | int, ...]] = []

    def heard() -> None:
        assert len(fronted.ends) == 2, "no spare yet: it would take the others' processor"
        if fronted.pool.home("attic") is None:
            return  # its worker has not been heard yet
        fronted.channel.heard = second

    def second() -> None:
        early.extend(fronted.asked(1))
        fronted.ends[2].send(Ready())
        fronted.channel.heard = lambda: None

    fronted.channel.heard = heard
    for _ in range(3):
        fronted.person.sendto(fronted.ask("attic"), fronted.public.getsockname())
    assert fronted.front.await_ready(LIMIT_S)
    assert early == [fronted.person.getsockname()]
    assert len(fronted.ends) == 3
    assert fronted.pool.workers[-1].state == "spare"


def test_a_room_that_is_not_there_yet_is_asked_for_again_and_a_start_that_is_stopped_ends_at_once(
    fronted: Fronted,
) -> None:
    fronted.front._take(fronted.ask("cellar"), (HOST, 1), 0, 0)
    assert fronted.front.dropped == {"room not there yet": 1}
    assert fronted.asked(2) == []
    fronted.stop.reason = "stopped"
    assert not fronted.front.await_ready(LIMIT_S)


@pytest.fixture
def ready(fronted: Fronted) -> Fronted:
    for end in fronted.ends.values():
        end.send(Ready())
    assert fronted.front.await_ready(LIMIT_S)
    return fronted


def answer(ready: Fronted, number: int, address: tuple[str | int, ...]) -> None:
    """Let a worker refuse somebody: no matter what it answers."""
    ready.ends[number].send(Say(address, refusal(7, "taken", "the seat is taken")))
    ready.front._take_of(ready.pool.workers[number - 1])


def test_people_who_come_by_one_link_at_once_wait_for_no_second_hello(ready: Fronted) -> None:
    """After a server stood still all its people notice it in the same moment, and repeat their hellos in step."""
    people = [(HOST, 1 + number) for number in range(40)]
    for number, address in enumerate(people):
        ready.front._take(ready.ask(("attic", "cellar")[number % 2]), address, time.monotonic_ns(), 0)
    for number, address in enumerate(people):
        worker = 1 + number % 2
        assert ready.asked(worker) == [address], "one at a time: the token may be good for one seat"
        answer(ready, worker, address)
    assert ready.front.dropped == {}
    assert len(ready.channel.outbox) + ready.front.sent == 40


def test_who_waits_for_a_token_is_asked_about_once_by_the_newest_hello(ready: Fronted) -> None:
    now_ns = time.monotonic_ns()
    for room, address in (("attic", (HOST, 1)), ("attic", (HOST, 2)), ("cellar", (HOST, 2))):
        ready.front._take(ready.ask(room), address, now_ns, now_ns)
    assert ready.asked(1) == [(HOST, 1)]
    answer(ready, 1, (HOST, 1))
    assert (ready.asked(1), ready.asked(2)) == ([], [(HOST, 2)])


def test_an_answer_that_never_comes_holds_nobody_up_for_ever(ready: Fronted) -> None:
    for address, at_ns in (((HOST, 1), 0), ((HOST, 2), 1), ((HOST, 3), ASKED_NS)):
        ready.front._take(ready.ask("attic"), address, at_ns, at_ns)
    assert ready.asked(1) == [(HOST, 1)]
    ready.front._poll(ASKED_NS + 1)
    assert ready.asked(1) == [(HOST, 3)]
    assert ready.front.dropped == {"token is asked about": 1}, "the second is gone, or says hello again"


def test_a_hello_goes_to_its_worker_with_the_time_at_which_it_came(
    ready: Fronted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A front that stood still has the hellos of seconds at once, and a worker bounds how many one person may send in one."""
    ready.person.bind((HOST, 0))
    sent_ns = time.monotonic_ns()
    ready.person.sendto(ready.ask("cellar"), ready.public.getsockname())
    came_ns = time.monotonic_ns()
    monkeypatch.setattr(public_socket, "time", SimpleNamespace(monotonic_ns=lambda: came_ns + 3_000_000_000))
    assert ready.asked(2) == []
    ready.front._drain()
    given, _ = ready.ends[2].take_at_worker()
    assert isinstance(given, Ask)
    assert sent_ns - CLOCKS_NS <= given.arrived_ns <= came_ns + CLOCKS_NS


@pytest.mark.parametrize("ticket", ["", "ticket-1"])
def test_a_worker_is_told_which_token_was_shown_with_a_ticket(ready: Fronted, ticket: str) -> None:
    assert ready.asked(2) == []
    asks = padded(msgspec.structs.replace(hello("anna"), room="cellar", ticket=ticket))
    ready.front._take(asks, (HOST, 9), time.monotonic_ns(), 0)
    given, _ = ready.ends[2].take_at_worker()
    assert isinstance(given, Ask)
    assert given.shown == ("0b9ee21b" if ticket else None)


class Seated(Fronted):
    """A front whose kernel steers, and a person with a seat in the second room."""

    def __init__(self) -> None:
        super().__init__(steers=True)
        self.person.bind((HOST, 0))
        self.place = self.person.getsockname()
        for end in self.ends.values():
            end.send(Ready())
        assert self.front.await_ready(LIMIT_S)
        self.seat()

    def seat(self, number: int = 2) -> None:
        """Let a worker welcome the person to the second room."""
        self.front._take(self.ask("cellar"), self.place, time.monotonic_ns(), 0)
        assert self.asked(number) == [self.place]
        settings = seat_settings(ROOMS[1], 0)
        self.tell(number, Say(self.place, messages.encode(Welcome(PROTOCOL_VERSION, 7, 5, "", "1", settings, "t"))))

    def tell(self, number: int, said: ToFront) -> None:
        """Let a worker say something, and the front take it in."""
        self.ends[number].send(said)
        self.front._take_of(next(worker for worker in self.pool.workers if worker.number == number))

    def told(self, number: int) -> list[ToWorker]:
        """Return what a worker was told since the last call."""
        found: list[ToWorker] = []
        with suppress(BlockingIOError):
            while True:
                found.append(self.ends[number].take_at_worker()[0])
        return found

    def arrives(self) -> list[int]:
        """Let the person send a datagram, and return where it came: 0 the front, then the workers' own sockets."""
        assert self.steering is not None
        self.steering.refresh()  # at the end of a turn
        self.person.sendto(b"waves", self.public.getsockname())
        found = []
        for number, each in enumerate([self.public, *self.steering.own]):
            with suppress(BlockingIOError):
                each.recv(100)
                found.append(number)
        return found


@pytest.fixture
def seated() -> Iterator[Seated]:
    with closing(Seated()) as made:
        yield made


def test_who_is_welcome_is_steered_to_the_worker_until_it_says_that_the_seat_is_over(seated: Seated) -> None:
    assert [each for each in seated.told(2) if isinstance(each, Path)] == [Path(seated.place, None, True)]
    assert seated.arrives() == [2]
    seated.tell(2, Released(seated.place))
    assert seated.arrives() == [0]
    assert seated.front.seated == {}
    seated.seat()
    assert seated.arrives() == [2]


def test_another_worker_that_gives_a_peer_up_too_late_changes_nothing(seated: Seated) -> None:
    seated.tell(1, Released(seated.place))
    assert seated.arrives() == [2]
    assert list(seated.front.seated) == [seated.place]


def test_a_datagram_that_was_faster_than_its_path_goes_back_to_the_worker(seated: Seated) -> None:
    seated.told(2)
    seated.tell(2, Astray(seated.place, b"waves"))
    assert seated.told(2) == [Stray(seated.place, b"waves")]
    assert seated.arrives() == [2]
    seated.tell(1, Astray((HOST, 9), seated.ask("attic")))
    assert seated.asked(1) == [(HOST, 9)], "of whoever has no seat: a hello"


def test_who_makes_a_new_association_comes_to_the_front_again(seated: Seated) -> None:
    seated.told(2)
    seated.front._take(seated.ask("cellar"), seated.place, time.monotonic_ns(), 0)
    assert Forget(seated.place) in seated.told(2)
    assert seated.arrives() == [0]


def test_people_of_a_worker_that_has_ended_come_to_the_front_and_then_to_the_next_one_by_the_same_socket(
    seated: Seated,
) -> None:
    dead = seated.pool.workers[1]
    dead.process = SimpleNamespace(pid=2, poll=lambda: -9, wait=lambda: -9)  # type: ignore[assignment]
    seated.ends[2].close()
    seated.front._take_of(dead)
    assert seated.arrives() == [0]
    assigned, (descriptor,) = seated.ends[3].take_at_worker()
    assert isinstance(assigned, Assign)
    assert (assigned.rooms, assigned.own) == (("cellar",), True)
    with socket.socket(fileno=descriptor) as handed:
        assert seated.steering is not None
        assert os.path.sameopenfile(handed.fileno(), seated.steering.own[1].fileno())
    seated.tell(3, Ready())
    seated.seat(3)
    assert seated.arrives() == [2]
