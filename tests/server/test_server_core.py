"""The server without I/O: who gets a seat, what is dropped and under which name, how people leave."""

from itertools import count
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.secure.channel import Address
from cogrip.protocol.settings.digest import digest
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Heartbeat, Hello, Leave, Refuse, Stamp, State, Waves, Welcome
from cogrip.protocol.wire.session import LOST_NS, make_hello
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import FAREWELL_EVERY_NS, ServerCore
from cogrip.server.inputs import Stop
from cogrip.sim.laboratory import Laboratory

FRAME_NS = 1_000_000_000 // 128


def room(name: str = "lab", people: tuple[str, ...] = ("anna", "ben"), **tables: object) -> Settings:
    return resolve({"name": name, "users": [{"name": person} for person in people], **tables})


class Desk:
    """A server core and what it says to whom."""

    token = ""

    def __init__(self, *rooms: Settings, services: AdmissionServices | None = None) -> None:
        services = services or AdmissionServices(count(100).__next__)
        self.core = ServerCore(rooms or (room(),), "test", services)
        self.now_ns = 0

    @property
    def states(self) -> list[str]:
        """The state of each seat of the first room."""
        return [seat.state for seat in self.core.rooms[0].seats]

    def say(self, datagram: bytes, address: Address) -> list[messages.AnyMessage]:
        self.core.receive(datagram, address, self.now_ns)
        return self.heard(address)

    def heard(self, address: Address) -> list[messages.AnyMessage]:
        mine = [messages.decode(datagram) for to, datagram in self.core.outbox if to == address]
        others = [(to, datagram) for to, datagram in self.core.outbox if to != address]
        self.core.outbox.clear()
        self.core.outbox.extend(others)
        return mine

    def hello(self, address: Address, **changed: object) -> messages.AnyMessage:
        (answer,) = self.say(messages.padded(hello(**changed)), address)
        return answer

    def welcome(self, address: Address, **changed: object) -> Welcome:
        answer = self.hello(address, **{"token": self.token, **changed})
        assert isinstance(answer, Welcome), answer
        return answer

    def refused(self, address: Address, **changed: object) -> Refuse:
        answer = self.hello(address, **changed)
        assert isinstance(answer, Refuse)
        assert self.core.dropped[f"refused: {answer.code}"] >= 1
        return answer

    def tick(self, number: int = 0) -> None:
        self.now_ns += FRAME_NS
        self.core.tick(self.core.rooms[number], self.now_ns)

    def push(self, address: Address, session: int, frames: int, *values: float) -> None:
        """Send so many frames of these waves, and step the first room after each."""
        for number in range(frames):
            self.core.receive(waves(session, number, *values), address, self.now_ns)
            self.tick()


def hello(**changed: object) -> Hello:
    given: dict[str, object] = {
        "software": "test", "nonce": 1, "room": "", "name": "", "digest": "", "device": "sim:ideal", "axes": 1,
        "rate_hz": 1024.0,
    }  # fmt: skip
    ticket = changed.pop("ticket", "")
    return msgspec.structs.replace(make_hello(**{**given, **changed}), ticket=ticket)  # type: ignore[arg-type]


def waves(session: int, number: int, *values: float, sent_ns: int = 1) -> bytes:
    zero = (0.0,) * len(values)
    return messages.encode(Waves(session, number, values, zero, zero, 0.0, 0.0, 0, Stamp(sent_ns), zero + zero))


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_seats_are_given_in_order_and_by_name_until_all_are_taken() -> None:
    desk = Desk(room(people=("anna", "ben", "carl")))
    given = [desk.welcome("x", name="ben"), desk.welcome("y"), desk.welcome("z")]
    seats = [(each.settings.user, each.settings.seat, each.session) for each in given]
    assert seats == [("ben", 1, 100), ("anna", 0, 101), ("carl", 2, 102)]
    assert [event.text.split(" joined")[0] for event in desk.core.events] == ["lab: ben", "lab: anna", "lab: carl"]
    assert desk.refused("w", name="ben").code == "taken"
    refuse = desk.refused("w", nonce=9)
    assert (refuse.code, refuse.nonce) == ("full", 9)
    assert "all 3 seats" in refuse.reason


@pytest.mark.parametrize(
    ("changed", "code", "words"),
    [
        ({"room": "three"}, "room", "no room 'three' here; there is: lab, hall"),
        ({"name": "zoe", "room": "lab"}, "name", "anna, ben"),
        ({"digest": "other"}, "settings", "use the same file"),
        ({"axes": 1}, "axes", "1 of the 2 axes"),
        ({"rate_hz": 1000.0}, "rate", "rates.device_hz = 1024"),
    ],
)
def test_a_client_that_does_not_fit(changed: dict[str, object], code: str, words: str) -> None:
    desk = Desk(room(object={"axes": 2}), room("hall", object={"axes": 2}))
    refuse = desk.refused("x", **{"axes": 2, **changed})
    assert refuse.code == code
    assert words in refuse.reason
    assert desk.states == ["free", "free"]
    desk.welcome("x", axes=2, digest=digest(desk.core.rooms[0].settings))


def test_a_device_is_held_against_its_own_seats_rate() -> None:
    """A hello without a name gets the first seat that the device fits; a name gets its own seat or the reason."""
    fast = resolve({"name": "lab", "users": [{"name": "anna", "device_hz": 4096}, {"name": "ben"}]})
    desk = Desk(fast)
    refuse = desk.refused("x", name="anna", rate_hz=4095.0)
    assert refuse.code == "rate"
    assert refuse.reason == ("device sim:ideal runs at 4095 Hz at most, the seat of 'anna' at users.0.device_hz = 4096")
    welcome = desk.welcome("y", rate_hz=1024.0)
    assert (welcome.settings.user, welcome.settings.rates) == ("ben", Rates(1024, 128))
    assert desk.refused("x", rate_hz=1024.0).code == "rate", "the seat that is left does not fit"
    assert desk.welcome("x", rate_hz=4096.0).settings.rates == Rates(4096, 128)


def test_another_protocol_version_is_refused_in_words(desk: Desk) -> None:
    future = [1, "cogrip", 99, "future", 7, "whatever", {"new": "things"}]
    assert desk.say(messages.encode(future), "x") == [], "short ones get no answer in any version"
    (answer,) = desk.say(messages.encode([*future, bytes(messages.HELLO_BYTES)]), "x")
    assert isinstance(answer, Refuse)
    assert (answer.code, answer.nonce) == ("version", 7)
    assert "protocol 99" in answer.reason


def test_a_repeated_hello_gets_the_same_welcome_and_a_client_that_starts_again_a_new_session(desk: Desk) -> None:
    first = desk.welcome("x", nonce=5)
    desk.now_ns += 250_000_000
    assert desk.welcome("x", nonce=5) == first
    assert desk.states == ["seated", "free"]
    assert len(desk.core.events) == 1
    assert desk.welcome("x", nonce=6).session != first.session
    assert desk.states == ["seated", "free"], "its old seat is lost"


def test_a_short_hello_is_not_answered(desk: Desk) -> None:
    """Else a forged address would get more than was sent."""
    assert desk.say(messages.encode(hello()), "x") == []
    assert desk.core.dropped == {"short hello": 1}
    assert desk.states[0] == "free"


def test_no_answer_to_an_unauthenticated_peer_is_longer_than_the_request() -> None:
    desk = Desk(room("n" * 40, people=tuple(letter * 40 for letter in "abcd")))
    for name in ("", "a" * 40, "z" * 40):
        query = messages.padded(hello(name=name))
        desk.core.receive(query, name, 0)
        assert len(desk.core.outbox[-1][1]) <= len(query)


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_garbage_is_counted_and_changes_nothing(datagrams: list[bytes]) -> None:
    desk = Desk()
    for datagram in datagrams:
        desk.core.receive(datagram, "x", 0)
    assert sum(desk.core.dropped.values()) == len(datagrams)
    assert desk.states == ["free", "free"]


@given(st.data())
def test_a_damaged_datagram_is_no_way_in(data: st.DataObject) -> None:
    """Any byte of a good datagram changed: the core goes on, its numbers stay finite."""
    desk = Desk()
    session = desk.welcome("x").session
    for number in range(5):
        good = bytearray(waves(session, number, 0.1))
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
        desk.core.receive(bytes(good), "x", desk.now_ns)
        desk.tick()
    assert np.all(np.isfinite(desk.core.rooms[0].world.position))


def test_what_is_not_for_this_session(desk: Desk) -> None:
    assert desk.say(waves(1, 0, 0.1), "stranger") == []
    session = desk.welcome("x").session
    for datagram in (waves(session + 1, 0, 0.1), messages.encode(Leave(session + 1, "forged"))):
        assert desk.say(datagram, "x") == []
    assert desk.say(messages.encode(Farewell(session, "forged")), "x") == []
    assert desk.core.dropped == {"not seated": 1, "other session": 2, "unexpected": 1}
    assert desk.core.rooms[0].seats[0].state == "seated"


@pytest.mark.parametrize(
    "datagram",
    [
        waves(100, 0, 0.1, 0.2),
        messages.encode(State(100, 0, (0.1,), (0.0,), 0.0, 0, Stamp(1))),
        messages.encode(Waves(100, 1 << 20, (0.1,), (0.0,), (0.0,), 0.0, 0.0, 0, Stamp(1), (0.0, 0.0))),
    ],
    ids=["axes", "kind", "number"],
)
def test_a_message_that_does_not_fit_the_room_is_unfit(desk: Desk, datagram: bytes) -> None:
    assert desk.welcome("x").session == 100
    desk.core.receive(datagram, "x", 0)
    assert desk.core.dropped == {"unfit": 1}


@pytest.mark.parametrize("kind", ["waves", "heartbeat"])
def test_an_implausible_stamp_is_counted_and_its_message_taken_in(desk: Desk, kind: str) -> None:
    """An echo of what was sent later than now is no reading of the clock; the message itself may be good."""
    session = desk.welcome("x").session
    seat, now_ns = desk.core.rooms[0].seats[0], 10**9
    for number, (held_ns, dropped) in enumerate([(10, 0), (11, 1)]):
        stamp = Stamp(now_ns, now_ns - 10, held_ns)  # not later than it was sent back, then 1 ns later
        frame = Waves(session, number, (0.1,), (0.0,), (0.0,), 0.0, 0.0, 0, stamp, (0.0, 0.0))
        message = frame if kind == "waves" else Heartbeat(session, stamp)
        desk.core.receive(messages.encode(message), "x", now_ns)
        assert desk.core.dropped["implausible stamp"] == dropped
        assert (seat.last_received_ns, seat.rtt_ns) == (now_ns, 0)
        now_ns += FRAME_NS
    assert desk.core.dropped == {"implausible stamp": 1}


def test_every_seated_person_gets_one_datagram_a_step(desk: Desk) -> None:
    sessions = [desk.welcome(address).session for address in "xy"]
    for number in range(3):
        desk.core.receive(waves(sessions[0], number, 0.1, sent_ns=desk.now_ns + 1), "x", desk.now_ns + 500)
        desk.tick()
        (answer,), (other,) = desk.heard("x"), desk.heard("y")
        assert isinstance(answer, Waves)
        assert answer.session == sessions[0]
        assert answer.first + len(answer.waves) == number + 1
        assert answer.stamp.echo_ns > 0
        assert isinstance(other, Heartbeat), "ben has not sent a frame yet: none of ours is spent on him"
        assert (other.session, other.stamp.echo_ns) == (sessions[1], 0)


def test_silence_frees_the_seat_after_two_seconds(desk: Desk) -> None:
    desk.welcome("x")
    session = desk.welcome("y").session
    while desk.now_ns + FRAME_NS <= LOST_NS:
        desk.core.receive(messages.encode(Heartbeat(session, Stamp(desk.now_ns + 1))), "y", desk.now_ns)
        desk.tick()
    assert desk.states == ["seated", "seated"]
    desk.tick()
    assert desk.states == ["free", "seated"]
    assert desk.core.dropped == {"seat timed out": 1}
    assert "anna has been silent" in desk.core.events[-1].text
    desk.heard("x")
    assert desk.say(waves(100, 0, 0.1), "x") == []
    assert desk.core.dropped["not seated"] == 1
    assert desk.welcome("z", name="anna").settings.seat == 0


def test_the_others_go_on_without_a_kick_when_one_falls_silent() -> None:
    """Two squeeze a cube, one line is cut. Neither the cut nor the seat's end 2 s later jolts the other hand."""
    hands = [{"name": "a", "hand": "reach&stroke_s=0.5&stop_s=0.5"}, {"name": "b", "hand": "hold"}]
    settings = room(seconds=6.0, users=[{**hand, "device": "sim:ideal"} for hand in hands])
    lab = Laboratory(settings)
    staying, gone = lab.people
    forces, held = [], []

    def watch(_: Laboratory) -> None:
        forces.append(staying.core.force_n[0])

    def cut(_: Laboratory) -> None:
        if lab.room.steps == 256:
            gone.up = SimpleNamespace(next_ns=None, send=lambda payload, now_ns: None)  # type: ignore[assignment]
            held.append(staying.core.force_n[0])

    lab.run(watch, cut)
    assert [seat.state for seat in lab.room.seats] == ["seated", "free"]
    after = np.array(forces[256 * 8 :])
    assert abs(held[0]) > 0.5, "they did squeeze"
    assert np.abs(after).max() <= abs(held[0]) * 1.1, "never more than was held"
    assert np.abs(np.diff(after)).max() < 0.25 * abs(held[0]), "it lets go over some frames"
    assert np.abs(np.diff(after[250 * 8 :])).max() < 1e-6, "when the seat is taken away nothing is felt"
    assert lab.room.world.position[0] == pytest.approx(0.03, abs=1e-6), "the cube is in the hand that is left"
    assert gone.core.safety.state == "degraded"
    assert max(map(abs, gone.core.force_n)) == 0.0


def test_leaving_is_answered_again_when_repeated(desk: Desk) -> None:
    session = desk.welcome("x").session
    desk.welcome("y")
    desk.core.receive(waves(session, 0, 0.1), "x", 0)
    desk.tick()
    desk.heard("x")
    leave = messages.encode(Leave(session, "done"))
    first = desk.say(leave, "x")
    assert isinstance(first[0], Farewell)
    assert first[0].seat is not None
    assert first[0].seat.up.applied == 1
    assert desk.say(leave, "x") == []  # it may be under way
    assert desk.core.dropped["said goodbye"] == 1
    desk.now_ns += FAREWELL_EVERY_NS
    assert desk.say(leave, "x") == first
    assert [event.text for event in desk.core.events if event.event == "left"] == ["lab: anna left: done"]
    assert desk.core.rooms[0].seats[0].state == "free"
    desk.tick()
    assert desk.heard("x") == []
    assert len(desk.heard("y")) == 2
    assert desk.welcome("z").settings.user == "anna"
    assert desk.say(leave, "x") == [], "the seat is someone else's now"


def test_stopping_says_farewell_to_everyone() -> None:
    desk = Desk(room("one"), room("two"))
    desk.welcome("x")
    desk.welcome("y", room="two")
    desk.core.handle(Stop("closing time"), desk.now_ns)
    for address in "xy":
        (farewell,) = desk.heard(address)
        assert isinstance(farewell, Farewell)
        assert farewell.reason == "closing time"
        assert farewell.room is not None
    assert all(seat.state == "free" for one in desk.core.rooms for seat in one.seats)
    desk.core.handle(Stop("again"), desk.now_ns)
    assert not desk.core.outbox


def test_a_hello_without_a_room_finds_a_seat_anywhere_and_rooms_do_not_feel_each_other() -> None:
    desk = Desk(room("one", ("anna",)), room("two", ("ben",)))
    first, second = desk.welcome("x"), desk.welcome("y")
    assert (first.settings.room, second.settings.room) == ("one", "two")
    assert desk.refused("z").code == "full"
    for number in range(60):
        desk.core.receive(waves(first.session, number, 0.2), "x", desk.now_ns)
        desk.core.receive(waves(second.session, number, 0.0), "y", desk.now_ns)
        desk.tick(0)
        desk.tick(1)
    one, two = desk.core.rooms
    assert one.world.position[0] > 1e-3
    assert two.world.position[0] == 0.0
    assert one.steps == two.steps == 60


def test_missed_steps_send_zeros_and_are_numbered_on(desk: Desk) -> None:
    session = desk.welcome("x").session
    desk.core.receive(waves(session, 0, 0.1), "x", desk.now_ns)
    desk.tick()
    for number in range(1, 5):
        desk.core.receive(waves(session, number, 0.1), "x", desk.now_ns)
    desk.core.tick(desk.core.rooms[0], desk.now_ns + 4 * FRAME_NS, frames=4)
    answer = desk.heard("x")[-1]
    assert isinstance(answer, Waves)
    assert answer.first + len(answer.waves) == 5
    assert answer.waves[1:4] == (0.0, 0.0, 0.0)
    port = desk.core.rooms[0].seats[0].port
    assert port is not None
    count = port.count()
    assert (count.applied, count.late, count.pending) == (2, 3, 0)


def test_an_object_that_leaves_the_room_is_named_and_everybody_told(desk: Desk) -> None:
    session = desk.welcome("x").session
    for number in range(400):  # with true totals: a line whose sums say that nothing was sent plays ever less
        sums = ((3.0 * number,), (9.0 * number,))
        wave = Waves(session, number, (3.0,), *sums, 0.0, 0.0, 0, Stamp(1), (0.0, 0.0))
        desk.core.receive(messages.encode(wave), "x", desk.now_ns)
        desk.tick()
    room = desk.core.rooms[0]
    assert [body.what for body in room.left] == ["the object"]
    assert room.unstable == ""
    assert (room.account().left, room.account().unstable) == (True, False)
    marks = [event.text for event in desk.core.events if "left the workspace" in event.text]
    assert len(marks) == 1
