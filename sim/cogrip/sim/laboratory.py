"""A whole session in virtual time: the very cores of the live processes, their datagrams, an emulated link, no sleeping.

At a frame border the order is that of theory section 6: every client senses and sends, what has arrived by now is
delivered, the server steps, its answers that have arrived by now are delivered, every client acts. A link delay of
exactly d frames therefore means d frames.

People may go and come, lose their address, or their server: `leave`, `come`, `lose_address`, `kill` and `restart`, each
between two frames. A way to the server is an address here, and dialling gives another one.
"""

from collections.abc import Callable, Sequence
from itertools import count

from cogrip.client.dialler import Dialler
from cogrip.client.handle import Handle
from cogrip.client.recorded import RecordedClient
from cogrip.devices.device import Device
from cogrip.devices.for_user import address_of, make_for
from cogrip.protocol.accounts import TickCount
from cogrip.protocol.link_profile import LinkProfile
from cogrip.protocol.rates import due_ns
from cogrip.protocol.recording.sink import Nowhere, Sink
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import Settings, digest
from cogrip.protocol.version import VERSION
from cogrip.server.checkpoint import RoomCheckpoint
from cogrip.server.recorded import RecordedServer
from cogrip.sim.link import LinkEmulator

Watch = Callable[["Laboratory"], None]
Record = Callable[[RecordedClient | RecordedServer, str], Sink]
"""Where an end's recording goes: called with its core and, for a client, the person's name (else "")."""


def unrecorded(core: RecordedClient | RecordedServer, who: str) -> Sink:
    """No recording."""
    return Nowhere()


class Person:
    """One user: device, core and the two directions of the link. visit: how often this person has come before."""

    def __init__(self, settings: Settings, number: int, begins: int, visit: int = 0) -> None:
        user = settings.users[number]
        self.begins = begins  # tick of the session that is this person's first
        self.visit = visit
        self.name = user.name
        self.going = self.gone = False
        self.lost: set[str] = set()  # addresses that nothing comes or goes by any more
        self._address = f"person {number}" + (f" again {visit}" if visit else "")
        self.dialler = Dialler(self._address)
        device = make_for(user, settings.object.axes)
        record = device.capability
        hello = make_hello(
            software=VERSION, nonce=number + 1 + visit * len(settings.users), room=settings.name, name=user.name,
            digest=digest(settings), device=address_of(user), axes=settings.object.axes, rate_hz=float(record.rate_hz),
            force_n=record.peak_force_n, speed_mps=record.speed_mps,
        )  # fmt: skip
        self.core = RecordedClient(hello, device.capability)
        self.handle = Handle(device, self.core, settings.rates.device_hz)
        self.up = LinkEmulator(LinkProfile(), "")
        self.down = LinkEmulator(LinkProfile(), "")

    @property
    def address(self) -> str:
        """Where the server hears this person from."""
        return self.dialler.way

    def ticks_at(self, tick: int) -> bool:
        """Whether this person's loop runs at a tick of the session."""
        return tick >= self.begins and not self.gone

    def dial(self, now_ns: int, refused: bool) -> None:
        """Another address, where the live client would dial anew."""
        resuming = self.core.session.state == "resuming"
        if self.dialler.due(now_ns, resuming, True, refused):
            self.dialler.dialled(f"{self._address} dial {self.dialler.dials + 1}", now_ns)
        self.dialler.spare(now_ns, resuming)

    @property
    def device(self) -> Device:
        return self.handle.device

    @device.setter
    def device(self, device: Device) -> None:
        self.handle.device = device


class Laboratory:
    """One session of `settings`. `run` to the end, or `frame` by frame.

    begins: each person's first tick, a whole number of frames; all begin together if it is empty.
    """

    def __init__(self, settings: Settings, record: Record = unrecorded, begins: Sequence[int] = ()) -> None:
        self.settings = settings
        begins = begins or (0,) * len(settings.users)
        self.people = [Person(settings, number, begin) for number, begin in enumerate(begins)]
        self._record = record
        self._sessions, self._tickets = count(1), count(1)
        self.server = self._new_server()
        self.room = self.server.rooms[0]
        self.alive = True  # the server
        self.now_ns = 0
        self.tick = 0
        self._device_hz = settings.rates.device_hz
        self._ticks_per_frame = settings.rates.device_hz // settings.rates.network_hz
        self.frames = max(1, round(settings.seconds * settings.rates.network_hz))
        for person in self.people:
            person.core.record(record(person.core, person.name))
        self.server.record(record(self.server, ""))
        for person in self.people:
            self._call(person)
        for person in self.people:
            self._begin(person)

    def _new_server(self) -> RecordedServer:
        return RecordedServer(
            [self.settings], VERSION, lambda: next(self._sessions), None, lambda: f"ticket-{next(self._tickets)}"
        )  # fmt: skip

    def _call(self, person: Person) -> None:
        """Hello and welcome over a perfect link; from then on the configured one."""
        now_ns = self.now_ns
        person.core.call(now_ns)
        while person.core.outbox:
            self.server.receive(person.core.outbox.popleft(), person.address, now_ns)
        self._from_server()
        for datagram in person.down.due(now_ns):
            person.core.receive(datagram, now_ns)
        if not person.core.seated:
            raise RuntimeError(person.core.session.failed or f"{person.name} was not seated")

    def _begin(self, person: Person) -> None:
        seat = person.core.seat
        assert seat is not None
        person.up = LinkEmulator(seat.up, f"{seat.seed}/{seat.seat}/up")
        person.down = LinkEmulator(seat.down, f"{seat.seed}/{seat.seat}/down")
        person.handle.open()

    # Coming and going

    def leave(self, number: int) -> None:
        """This person lets the force go and then says goodbye, as the live client does."""
        person = self.people[number]
        person.going = True
        person.core.stop()

    def come(self, number: int) -> Person:
        """Who had this seat before comes again, with a hand that begins anew."""
        before = self.people[number]
        person = self.people[number] = Person(self.settings, number, self.tick, before.visit + 1)
        self.now_ns = due_ns(0, self.tick, self._device_hz)
        person.core.record(self._record(person.core, f"{person.name} {person.visit + 1}"))
        self._call(person)
        self._begin(person)
        return person

    def lose_address(self, number: int) -> None:
        """Nothing comes or goes by this person's present address any more."""
        person = self.people[number]
        person.lost |= set(person.dialler.ways)

    def kill(self) -> list[RoomCheckpoint]:
        """The server is gone, between two steps and without a word. Returns what its next checkpoint would have held."""
        self.alive = False
        self.server.outbox.clear()
        return self.server.checkpoint()

    def restart(self, checkpoints: Sequence[RoomCheckpoint]) -> None:
        """A new server at the old one's place. It is not recorded."""
        self.server = self._new_server()
        self.server.record(Nowhere())
        self.room = self.server.rooms[0]
        for checkpoint in checkpoints:
            self.server.restore(checkpoint, self.now_ns)
        self.alive = True

    # Words on their way

    def _from_clients(self) -> None:
        for person in self.people:
            outbox = person.core.outbox
            while outbox:
                person.up.send(outbox.popleft(), self.now_ns)

    def _to_server(self) -> None:
        now_ns = self.now_ns
        for person in self.people:
            next_ns = person.up.next_ns
            if next_ns is None or next_ns > now_ns:
                continue
            dialler, hello = person.dialler, person.core.session.hello
            for datagram in person.up.due(now_ns):
                address = dialler.asking if datagram == hello else dialler.way
                if self.alive and address not in person.lost:
                    self.server.receive(datagram, address, now_ns)

    def _from_server(self) -> None:
        outbox = self.server.outbox
        while outbox:
            address, datagram = outbox.popleft()
            for person in self.people:
                dialler = person.dialler
                if address not in dialler.ways or address in person.lost:
                    continue
                if dialler.newer is not None and person.core.session.answers(datagram):
                    dialler.adopt(str(address))
                person.down.send(datagram, self.now_ns)

    def _to_clients(self) -> None:
        now_ns = self.now_ns
        for person in self.people:
            next_ns = person.down.next_ns
            if next_ns is not None and next_ns <= now_ns:
                for datagram in person.down.due(now_ns):
                    person.core.receive(datagram, now_ns)

    def frame(self, each_tick: Watch | None = None) -> None:
        """One network frame: M device ticks, the border first."""
        for step in range(self._ticks_per_frame):
            now_ns = self.now_ns = due_ns(0, self.tick, self._device_hz)
            self._sense(step == 0)
            if step == 0:
                self._from_clients()
                self._to_server()
                if self.alive:
                    self.server.tick(self.room, now_ns)
                self._from_server()
            self._to_clients()
            self._act()
            if each_tick is not None:
                each_tick(self)
            self.tick += 1

    def _sense(self, border: bool) -> None:
        tick, now_ns = self.tick, self.now_ns
        for person in self.people:
            if person.ticks_at(tick):
                person.core.sense(tick - person.begins, person.handle.read(tick - person.begins), now_ns)
            elif border and person.gone:
                person.core.poll(now_ns)
            elif border:
                person.core.keep_seat(now_ns)

    def _act(self) -> None:
        tick, now_ns = self.tick, self.now_ns
        for person in self.people:
            core = person.core
            if person.ticks_at(tick):
                person.handle.write(core.act(now_ns))
            if core.session.state == "resuming" or person.dialler.newer is not None:
                person.dial(now_ns, not self.alive)
            if person.going and core.released:
                self._say_goodbye(person)

    def _say_goodbye(self, person: Person) -> None:
        person.going, person.gone = False, True
        ticks = self.tick - person.begins
        person.core.leave("had enough", person.core.account(TickCount(due=ticks, run=ticks)), self.now_ns)
        person.device.close()

    def run(
        self,
        each_tick: Watch | None = None,
        each_frame: Watch | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        """To the end of the session, until it has diverged, or until `stopped` says so."""
        while self.tick < self.frames * self._ticks_per_frame and not self.diverged and not stopped():
            self.frame(each_tick)
            if each_frame is not None:
                each_frame(self)

    def close_books(self) -> None:
        """Note what every end knows; nothing is recorded after."""
        ticks = self.ticks()
        for person in self.people:
            person.core.account(ticks)
        self.server.close_books()
        self.server.record(Nowhere())
        for person in self.people:
            person.core.record(Nowhere())

    @property
    def diverged(self) -> str:
        """Why the session has diverged, "" if it has not."""
        for person in self.people:
            if person.core.diverged:
                return f"{person.name}: {person.core.diverged}"
        return self.room.diverged

    @property
    def seconds(self) -> float:
        """Virtual time that has passed."""
        return self.tick / self._device_hz

    def ticks(self) -> TickCount:
        """In virtual time every tick is run, and none is late."""
        return TickCount(due=self.tick, run=self.tick)
