"""An observer without I/O: the session, the newest view of the object, each person and each body of a scene."""

from collections import deque

from cogrip.client.inputs import Connect, Leave, Poll, Reached, SessionInput
from cogrip.client.markers import Markers
from cogrip.client.observed_scene import ObservedScene
from cogrip.machine.histogram import DurationHistogram
from cogrip.protocol.settings.effects import Effect
from cogrip.protocol.wire.messages import Bodies, Effects, Geom, Mark, Note, Person, View
from cogrip.protocol.wire.session import ClientSession

MOST_MARKED = 64  # most markers kept for an owner that does not read them
GONE_NS = 1_000_000_000
"""Time without a message about a person after which they are left out; at least 16 come a second."""


class ObserverCore:
    """`view` is the newest one, None before the first; `age_ns` says how old it is.

    people   seat -> newest message about who has it; those without one for GONE_NS are left out. An older server sends none
    marked   markers that came, for its owner to empty
    scene    shapes and poses of a scene's bodies, and sentences about it
    effects  haptic effects of the room by number, places in the object's frame
    """

    def __init__(self, session: ClientSession) -> None:
        """session: a new one, or one whose welcome gave an observer's place."""
        self.session = session
        self.rtt = DurationHistogram()
        self.view: View | None = None
        self.views = 0
        self.people: dict[int, Person] = {}
        self.scene = ObservedScene()
        self.effects: dict[int, Effect] = {}
        self._effects_of = (0, 0)  # session and version
        self.marked: list[Mark] = []  # markers since its owner emptied it
        self._markers = Markers()
        self._heard_ns: dict[int, int] = {}
        self._seen_ns = 0
        self._session_id = 0

    @property
    def outbox(self) -> deque[bytes]:
        """Messages to send, oldest first."""
        return self.session.outbox

    def handle(self, given: SessionInput, now_ns: int) -> None:
        """Do what an input asks for. `Poll` also sends the sign of life."""
        session = self.session
        match given:
            case Connect():
                session.connect(now_ns)
            case Poll():
                session.poll(now_ns)
                session.heartbeat(now_ns)
            case Reached():
                session.reached(now_ns)
            case Leave():
                session.leave(given.reason, None, now_ns)

    def receive(self, datagram: bytes, now_ns: int) -> None:
        message = self.session.receive(datagram, now_ns)
        if isinstance(message, Person):
            self._receive_person(message, now_ns)
            return
        if isinstance(message, Mark):
            if self._markers.receive(message, None) and len(self.marked) < MOST_MARKED:
                self.marked.append(message)
            return
        if isinstance(message, Effects):
            self._receive_effects(message)
            return
        if isinstance(message, Bodies | Geom | Note):
            if reason := self.scene.receive(message):
                self.session.drop(reason)
            return
        if not isinstance(message, View):  # the session counts a coupling's frames as unexpected
            return
        rtt_ns = self.session.clock.read(message.stamp, now_ns)
        if rtt_ns is not None:
            self.rtt.add(rtt_ns)
        if not _fits(message):
            self.session.drop("unfit")
        elif self.view is not None and message.session == self._session_id and message.number <= self.view.number:
            self.session.drop("late view")
        else:
            self.view, self._session_id, self._seen_ns = message, message.session, now_ns
            self.views += 1
            for seat in [seat for seat, heard_ns in self._heard_ns.items() if now_ns - heard_ns > GONE_NS]:
                del self.people[seat], self._heard_ns[seat]

    def _receive_effects(self, told: Effects) -> None:
        session, version = self._effects_of
        if told.session == session and told.version < version:
            self.session.drop("late effects")
            return
        kept = self.effects if told.session == session else {}
        self._effects_of = told.session, told.version
        self.effects = {number: effect for number, effect in kept.items() if number in told.numbers}
        if told.effect is not None and told.number in told.numbers:
            self.effects[told.number] = told.effect

    def _receive_person(self, person: Person, now_ns: int) -> None:
        before = self.people.get(person.seat)
        if before is not None and before.session == person.session and person.number <= before.number:
            self.session.drop("late person")
        else:
            self.people[person.seat], self._heard_ns[person.seat] = person, now_ns

    def age_ns(self, now_ns: int) -> int | None:
        """Return the time since the newest view came, None before the first."""
        return None if self.view is None else now_ns - self._seen_ns


def _fits(view: View) -> bool:
    """Return True where hands and forces are those of the seats it names."""
    axes, odd = divmod(len(view.object), 2)
    return not odd and len(view.proxies_m) == len(view.forces_n) == axes * len(view.seats)
