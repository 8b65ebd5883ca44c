"""A whole session in virtual time: the very cores of the live processes, their datagrams, an emulated link, no sleeping.

At a frame border the order is that of theory section 6: every client senses and sends, what has arrived by now is
delivered, the server steps, its answers that have arrived by now are delivered, every client acts. A link delay of
exactly d frames therefore means d frames.
"""

from collections.abc import Callable, Sequence
from itertools import count

from cogrip.client.handle import Handle
from cogrip.client.recorded import RecordedClient
from cogrip.devices.device import Device
from cogrip.devices.for_user import address_of, make_for
from cogrip.protocol.accounts import TickCount
from cogrip.protocol.rates import due_ns
from cogrip.protocol.recording.sink import Nowhere, Sink
from cogrip.protocol.session import make_hello
from cogrip.protocol.settings import LinkProfile, Settings, digest
from cogrip.protocol.version import VERSION
from cogrip.server.recorded import RecordedServer
from cogrip.sim.link import LinkEmulator

Watch = Callable[["Laboratory"], None]
Record = Callable[[RecordedClient | RecordedServer, str], Sink]
"""Where an end's recording goes: called with its core and, for a client, the person's name (else "")."""


def unrecorded(core: RecordedClient | RecordedServer, who: str) -> Sink:
    """No recording."""
    return Nowhere()


class Person:
    """One user: device, core and the two directions of the link."""

    def __init__(self, settings: Settings, number: int, begins: int) -> None:
        user = settings.users[number]
        self.begins = begins  # tick of the session that is this person's first
        self.name = user.name
        self.address = f"person {number}"
        device = make_for(user, settings.object.axes)
        hello = make_hello(
            software=VERSION, nonce=number + 1, room=settings.name, name=user.name, digest=digest(settings),
            device=address_of(user), axes=settings.object.axes, rate_hz=float(device.capability.rate_hz),
        )  # fmt: skip
        self.core = RecordedClient(hello, device.capability)
        self.handle = Handle(device, self.core, settings.rates.device_hz)
        self.up = LinkEmulator(LinkProfile(), "")
        self.down = LinkEmulator(LinkProfile(), "")

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
        sessions = count(1)
        self.server = RecordedServer([settings], VERSION, lambda: next(sessions))
        self.room = self.server.rooms[0]
        self.now_ns = 0
        self.tick = 0
        self._device_hz = settings.rates.device_hz
        self._ticks_per_frame = settings.rates.device_hz // settings.rates.network_hz
        self.frames = max(1, round(settings.seconds * settings.rates.network_hz))
        for person in self.people:
            person.core.record(record(person.core, person.name))
        self.server.record(record(self.server, ""))
        self._seat_everyone()

    def _seat_everyone(self) -> None:
        """Hello and welcome over a perfect link before time 0; from then on the configured one."""
        for person in self.people:
            person.core.call(0)
            self._exchange()
            if not person.core.seated:
                raise RuntimeError(person.core.session.failed or f"{person.name} was not seated")
        for person in self.people:
            seat = person.core.seat
            assert seat is not None
            person.up = LinkEmulator(seat.up, f"{seat.seed}/{seat.seat}/up")
            person.down = LinkEmulator(seat.down, f"{seat.seed}/{seat.seat}/down")
            person.handle.open()

    def _exchange(self) -> None:
        self._from_clients()
        self._to_server()
        self._from_server()
        self._to_clients()

    def _from_clients(self) -> None:
        for person in self.people:
            outbox = person.core.outbox
            while outbox:
                person.up.send(outbox.popleft(), self.now_ns)

    def _to_server(self) -> None:
        now_ns = self.now_ns
        for person in self.people:
            next_ns = person.up.next_ns
            if next_ns is not None and next_ns <= now_ns:
                for datagram in person.up.due(now_ns):
                    self.server.receive(datagram, person.address, now_ns)

    def _from_server(self) -> None:
        outbox = self.server.outbox
        while outbox:
            address, datagram = outbox.popleft()
            for person in self.people:
                if person.address == address:
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
        people = self.people
        for step in range(self._ticks_per_frame):
            tick = self.tick
            now_ns = self.now_ns = due_ns(0, tick, self._device_hz)
            for person in people:
                if tick >= person.begins:
                    person.core.sense(tick - person.begins, person.handle.read(tick - person.begins), now_ns)
                elif step == 0:
                    person.core.keep_seat(now_ns)
            if step == 0:
                self._from_clients()
                self._to_server()
                self.server.tick(self.room, now_ns)
                self._from_server()
            self._to_clients()
            for person in people:
                if tick >= person.begins:
                    person.handle.write(person.core.act(now_ns))
            if each_tick is not None:
                each_tick(self)
            self.tick += 1

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
