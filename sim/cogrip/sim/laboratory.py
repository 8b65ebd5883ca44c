"""A whole session in virtual time: the cores of the live processes, their datagrams, an emulated link, no sleeping.

At a step of the server the order is that of theory section 6: every client senses and sends, what has arrived by now is
delivered, the server steps, its answers that have arrived by now are delivered, every client acts. A link delay of exactly d
frames therefore means d frames.

Between two steps every client ticks on its own grid, exactly: those of one rate at the same moments, in seat order. A client
sends what is ready, and receives what has arrived, when it ticks itself; the server learns when it arrived. All begin together.

People may leave and return, lose their address, or their server: `leave`, `come`, `lose_address`, `kill` and `restart`, each
between two frames. A network path is an address here, and path migration gives another one.
"""

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import count
from typing import Literal

from cogrip.client import inputs
from cogrip.client.path_migration import PathMigration
from cogrip.client.recorder import RecordedClient
from cogrip.client.safety.device_port import DevicePort
from cogrip.client.supervised_device import SupervisedDevice
from cogrip.devices.device import Device
from cogrip.devices.for_user import address_of, make_for
from cogrip.machine.tick_count import TickCount
from cogrip.protocol.recording.sink import Nowhere, Sink
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.link_profile import LinkProfile
from cogrip.protocol.settings.rates import due_ns
from cogrip.protocol.settings.room import rates_of, seat_axes
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.version import VERSION
from cogrip.protocol.wire.session import make_hello
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.checkpoint import RoomCheckpoint
from cogrip.server.inputs import CloseLedger, Mark, Restore
from cogrip.server.recorder import RecordedServer
from cogrip.sim.bare_port import BarePort
from cogrip.sim.link import LinkEmulator, configured_link

Watch = Callable[["Laboratory"], None]
Moment = tuple[tuple[int, int], ...]
"""Simultaneous ticks: seat numbers, each with its tick in the frame."""
Record = Callable[[RecordedClient | RecordedServer, str], Sink]
"""Function that gives the sink of an end's recording, from its core and, for a client, the person's name (else "")."""


def unrecorded(core: RecordedClient | RecordedServer, who: str) -> Sink:
    """Return a sink that records nothing."""
    return Nowhere()


class LaboratoryPerson:
    """One user: device, core and both directions of the link. visit: how often this person has been in the room before."""

    def __init__(self, settings: Settings, number: int, begins: int, visit: int = 0, bare: bool = False) -> None:
        user = settings.users[number]
        self.begins = begins  # tick of the session, at this person's rate, that is their first
        self.rates = rates_of(settings, user)
        self.ticks_per_frame = self.rates.ticks_per_frame
        self.visit = visit
        self.name = user.name
        self.going = self.gone = False
        self.lost: set[str] = set()  # addresses that carry nothing any more
        self._address = f"person {number}" + (f" again {visit}" if visit else "")
        self.migration = PathMigration(self._address)
        device = make_for(user, seat_axes(settings, user))
        record = device.capability
        hello = make_hello(
            software=VERSION, nonce=number + 1 + visit * len(settings.users), room=settings.name, name=user.name,
            digest=digest(settings), device=address_of(user), **record.claims,
        )  # fmt: skip
        self.core = RecordedClient(hello, device.capability, BarePort if bare else DevicePort)
        self.supervised = SupervisedDevice(device, self.core, self.rates.device_hz)
        self.up = LinkEmulator(LinkProfile(), "")
        self.down = LinkEmulator(LinkProfile(), "")

    @property
    def address(self) -> str:
        """The address from which the server receives this person's datagrams."""
        used: str = self.migration.path
        return used

    def migrate(self, now_ns: int, refused: bool) -> None:
        """Change the address where the live client would migrate to another path."""
        resuming = self.core.session.state == "resuming"
        if self.migration.due(now_ns, resuming, True, refused):
            self.migration.tried(f"{self._address} path {self.migration.attempts + 1}", now_ns)
        self.migration.spare(now_ns, resuming)

    @property
    def device(self) -> Device:
        return self.supervised.device

    @device.setter
    def device(self, device: Device) -> None:
        self.supervised.device = device


class Laboratory:
    """One session of `settings`. `run` to the end, or `frame` by frame.

    bare: without the passivity controllers of the device port, for experiments on them (`BarePort`)
    begins: each person's first tick, at their own rate, a whole number of frames; all begin together if it is empty
    tick: moments so far at which somebody ticked, or is ticking; with one rate for all, everybody's tick
    """

    def __init__(
        self, settings: Settings, record: Record = unrecorded, begins: Sequence[int] = (), *, bare: bool = False
    ) -> None:
        self.settings = settings
        self._bare = bare
        begins = begins or (0,) * len(settings.users)
        self.people = [LaboratoryPerson(settings, number, begin, bare=bare) for number, begin in enumerate(begins)]
        self._record = record
        self._sessions, self._tickets = count(1), count(1)
        self.server = self._new_server()
        self.room = self.server.rooms[0]
        self.alive = True  # the server
        self.now_ns = 0
        self.tick = 0
        self._network_hz = settings.rates.network_hz
        self._frame = 0  # the current one, or the next
        self._moments = moments_of([person.ticks_per_frame for person in self.people])
        self.frames = max(1, round(settings.seconds * settings.rates.network_hz))
        for person in self.people:
            person.core.record(record(person.core, person.name))
        self.server.record(record(self.server, ""))
        for person in self.people:
            self._call(person)
        for person in self.people:
            self._begin(person)

    def _new_server(self) -> RecordedServer:
        services = AdmissionServices(lambda: next(self._sessions), new_ticket=lambda: f"ticket-{next(self._tickets)}")
        return RecordedServer([self.settings], VERSION, services)

    def _call(self, person: LaboratoryPerson) -> None:
        """Exchange hello and welcome over a perfect link; from then on the configured one holds."""
        now_ns = self.now_ns
        person.core.handle(inputs.Connect(), now_ns)
        while person.core.outbox:
            self.server.receive(person.core.outbox.popleft(), person.address, now_ns)
        self._from_server()
        for datagram in person.down.due(now_ns):
            person.core.receive(datagram, now_ns)
        if not person.core.seated:
            raise RuntimeError(person.core.session.failed or f"{person.name} was not seated")

    def _begin(self, person: LaboratoryPerson) -> None:
        seat = person.core.seat
        assert seat is not None
        link = self.settings.link
        person.up = configured_link(link, "up", f"{seat.seed}/{seat.seat}/up")
        person.down = configured_link(link, "down", f"{seat.seed}/{seat.seat}/down")
        person.supervised.open()

    # Leaving and returning

    def leave(self, number: int) -> None:
        """Release this person's force, and then say goodbye, as the live client does."""
        person = self.people[number]
        person.going = True
        person.core.handle(inputs.Stop(), self.now_ns)

    def come(self, number: int) -> LaboratoryPerson:
        """Return a new person in this seat: the same one again, with a hand that begins anew."""
        before = self.people[number]
        begins = self._frame * before.ticks_per_frame
        person = self.people[number] = LaboratoryPerson(self.settings, number, begins, before.visit + 1, self._bare)
        self.now_ns = due_ns(0, self._frame, self._network_hz)
        person.core.record(self._record(person.core, f"{person.name} {person.visit + 1}"))
        self._call(person)
        self._begin(person)
        return person

    def mark(self, text: str) -> None:
        """Set a marker, at the beginning of the next frame."""
        self.now_ns = due_ns(0, self._frame, self._network_hz)
        self.server.handle(Mark(text), self.now_ns)

    def lose_address(self, number: int) -> None:
        """Drop everything to and from this person's present addresses from now on."""
        person = self.people[number]
        person.lost |= set(person.migration.paths)

    def kill(self) -> list[RoomCheckpoint]:
        """Kill the server between two steps, and return the checkpoint that it would have written next."""
        self.alive = False
        self.server.outbox.clear()
        return self.server.checkpoint()

    def restart(self, checkpoints: Sequence[RoomCheckpoint]) -> None:
        """Start a new server in the old one's place. It is not recorded."""
        self.server = self._new_server()
        self.server.record(Nowhere())
        self.room = self.server.rooms[0]
        for checkpoint in checkpoints:
            self.server.handle(Restore(checkpoint), self.now_ns)
        self.alive = True

    # Datagrams

    def _from_clients(self) -> None:
        for person in self.people:
            outbox = person.core.session.outbox
            while outbox:
                person.up.send(outbox.popleft(), self.now_ns)

    def _to_server(self) -> None:
        now_ns = self.now_ns
        for person in self.people:
            next_ns = person.up.next_ns
            if next_ns is None or next_ns > now_ns:
                continue
            migration, hello = person.migration, person.core.session.hello
            for at_ns, datagram in person.up.arrivals(now_ns):
                address = migration.newest if datagram == hello else migration.path
                if self.alive and address not in person.lost:
                    self.server.receive(datagram, address, at_ns)

    def _from_server(self) -> None:
        outbox = self.server.outbox
        while outbox:
            address, datagram = outbox.popleft()
            for person in self.people:
                migration = person.migration
                if address not in migration.paths or address in person.lost:
                    continue
                if migration.newer is not None and person.core.session.is_welcome(datagram):
                    migration.adopt(str(address))
                person.down.send(datagram, self.now_ns)

    def _to_clients(self, moment: Moment) -> None:
        now_ns = self.now_ns
        for number, _ in moment:
            person = self.people[number]
            next_ns = person.down.next_ns
            if next_ns is not None and next_ns <= now_ns:
                for datagram in person.down.due(now_ns):
                    person.core.receive(datagram, now_ns)

    def frame(self, each_tick: Watch | None = None) -> None:
        """Run one network frame: everybody's M device ticks, the border first."""
        for moment in self._moments:
            number, step = moment[0]
            person = self.people[number]
            now_ns = self.now_ns = due_ns(0, self._frame * person.ticks_per_frame + step, person.rates.device_hz)
            self._sense(moment, step == 0)
            self._from_clients()
            if step == 0:
                self._to_server()
                if self.alive:
                    self.server.tick(self.room, now_ns)
                self._from_server()
            self._to_clients(moment)
            self._act(moment)
            if each_tick is not None:
                each_tick(self)
            self.tick += 1
        self._frame += 1

    def _sense(self, moment: Moment, border: bool) -> None:
        frame, now_ns = self._frame, self.now_ns
        for number, step in moment:
            person = self.people[number]
            tick = frame * person.ticks_per_frame + step - person.begins
            if tick >= 0 and not person.gone:
                person.core.sense(tick, person.supervised.read(tick), now_ns)
            elif border and person.gone:
                person.core.handle(inputs.Poll(), now_ns)
            elif border:
                person.core.handle(inputs.KeepSeat(), now_ns)

    def _act(self, moment: Moment) -> None:
        frame, now_ns = self._frame, self.now_ns
        for number, step in moment:
            person = self.people[number]
            core, tick = person.core, frame * person.ticks_per_frame + step - person.begins
            if tick >= 0 and not person.gone:
                person.supervised.write(core.act(now_ns))
            if core.session.state == "resuming" or person.migration.newer is not None:
                person.migrate(now_ns, not self.alive)
            if person.going and core.may_leave:
                self._say_goodbye(person, tick)

    def _say_goodbye(self, person: LaboratoryPerson, ticks: int) -> None:
        person.going, person.gone = False, True
        person.core.handle(inputs.CloseLedger(TickCount(due=ticks, run=ticks)), self.now_ns)
        person.core.handle(inputs.Leave("had enough"), self.now_ns)
        person.supervised.close()

    def run(
        self,
        each_tick: Watch | None = None,
        each_frame: Watch | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """Run to the end of the session, until the world has ended, or until `stopped` returns True.

        What is unstable, saturates or leaves ends nothing: the ends let go and go on, as live.
        """
        while self._frame < self.frames and not self.room.world.failed and not stopped():
            self.frame(each_tick)
            if each_frame is not None:
                each_frame(self)

    def close_ledger(self) -> None:
        """Record every end's accounts; nothing is recorded after."""
        for number, person in enumerate(self.people):
            person.core.handle(inputs.CloseLedger(self.ticks(number)), self.now_ns)
        self.server.handle(CloseLedger(), self.now_ns)
        self.server.record(Nowhere())
        for person in self.people:
            person.core.record(Nowhere())

    @property
    def unstable(self) -> Sequence[str]:
        """Return what was unstable so far, in words: the force at a hand, the numbers of the world."""
        return [*_told(self.people, "unstable"), *([self.room.unstable] if self.room.unstable else ())]

    @property
    def saturated(self) -> Sequence[str]:
        """Return whose force sat at a device's limit and was let go so far, in words."""
        return _told(self.people, "saturated")

    @property
    def left(self) -> Sequence[str]:
        """Return what left the workspace so far, in words: hands, the object, bodies of a scene."""
        bodies = [f"{body.what} left the workspace at {body.at_s:.3g} s" for body in self.room.left]
        return [*_told(self.people, "left"), *bodies]

    @property
    def incident(self) -> str:
        """Return what went wrong so that later numbers are nothing to compare, the gravest first; "" where nothing did.

        That is what was unstable, saturated until it was a fault, or left.
        """
        faulty = [person for person in self.people if person.core.in_fault]
        return next(iter([*self.unstable, *_told(faulty, "saturated"), *self.left]), "")

    @property
    def seconds(self) -> float:
        """The virtual time that has passed, in whole frames [s]."""
        return self._frame / self._network_hz

    def ticks(self, number: int = 0) -> TickCount:
        """Return the tick count of one person's loop. In virtual time every tick is run, and none is late."""
        ticks = self._frame * self.people[number].ticks_per_frame
        return TickCount(due=ticks, run=ticks)


def _told(people: Sequence[LaboratoryPerson], what: Literal["unstable", "saturated", "left"]) -> list[str]:
    """Return what the clients tell of themselves, with names."""
    return [f"{person.name}: {words}" for person in people if (words := getattr(person.core, what))]


def moments_of(ticks_per_frame: Sequence[int]) -> tuple[Moment, ...]:
    """Return a frame's moments in order, for seats with so many ticks in it; everybody ticks at the first, the border.

    Two ticks that are not simultaneous are 2.5 ns or more apart: 1 / (M_i M_j network_hz), M_i ticks a frame of seat i.
    """
    at: dict[Fraction, list[tuple[int, int]]] = {}
    for number, ticks in enumerate(ticks_per_frame):
        for step in range(ticks):
            at.setdefault(Fraction(step, ticks), []).append((number, step))
    return tuple(tuple(at[when]) for when in sorted(at))
