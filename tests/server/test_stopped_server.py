"""Server whose process stood still: it takes in all that waited, and gives people time to answer, before it ends a seat."""

from collections import deque
from itertools import count
from types import SimpleNamespace

import pytest

from cogrip.protocol.secure.channel import Address
from cogrip.protocol.wire.messages import MAX_DATAGRAM_BYTES, Heartbeat, Stamp, Welcome, decode, encode, padded
from cogrip.protocol.wire.session import LOST_NS, QUIET_NS
from cogrip.server.core import ServerCore
from cogrip.server.io import datagram_path
from cogrip.server.io.datagram_path import AWAY_NS, MOST_AT_ONCE, DatagramPath
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener

from tests.protocol.two_ends import MS, hello, seated, waves
from tests.server.test_resumption import Guarded
from tests.server.test_server_core import room

AWAY_S = 5
S = 1000 * MS


class Waited:
    """A port with (datagram, address, arrival) in its buffer; what is sent is kept."""

    def __init__(self, *buffer: tuple[bytes, Address, int]) -> None:
        self.buffer = deque(buffer)
        self.sent: list[tuple[Address, bytes]] = []

    def receive(self, most_bytes: int, now_ns: int) -> tuple[bytes, Address, int]:
        assert most_bytes == MAX_DATAGRAM_BYTES + 1
        if not self.buffer:
            raise BlockingIOError
        return self.buffer.popleft()

    def send_all(self, outbox: deque[tuple[Address, bytes]]) -> list[str]:
        self.sent += outbox
        outbox.clear()
        return []

    def overruns(self) -> int:
        return 0

    def close(self) -> None: ...


def path_of(port: Waited, core: ServerCore) -> DatagramPath:
    return DatagramPath(port, UnencryptedListener(RateLimiter(bytes(16)), core.listens_to), core, 4 * MS)


@pytest.fixture(autouse=True)
def still(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taking datagrams in takes no time."""
    monkeypatch.setattr(datagram_path, "time", SimpleNamespace(monotonic_ns=lambda: 0))


def test_a_person_whose_server_stood_still_keeps_the_session_at_the_newest_address() -> None:
    _, core = seated(now_ns=0, tickets=True)
    room = core.rooms[0]
    seat = room.seats[0]
    again = padded(hello(ticket="ticket-1"))
    port = Waited(
        (waves(100), "anna's", 400 * MS),
        (again, "anna's", 500 * MS),  # at the tick at which she notices the silence, before she has another path
        *((again, f"path {ms // 1000}", ms * MS) for ms in range(750, 1000 * AWAY_S, 250)),
        *((b"noise", "an unauthenticated peer", ns) for ns in range(2 * MOST_AT_ONCE)),
        (again, "path 5", AWAY_S * S),
    )
    path = path_of(port, core)
    path.drain(AWAY_S * S, AWAY_S * S)
    core.tick(room, AWAY_S * S)
    assert (seat.state, seat.session, seat.address) == ("seated", 100, "path 5")
    assert "seat timed out" not in core.dropped
    assert path.cut_short == 0
    path.send()
    answers = [decode(datagram) for address, datagram in port.sent if address == "path 5"]
    assert isinstance(answers[0], Welcome)


@pytest.mark.parametrize(("late_ns", "taken"), [(0, MOST_AT_ONCE), (AWAY_NS - 1, MOST_AT_ONCE), (AWAY_NS, 3000)])
def test_a_flood_is_cut_short_unless_the_loop_was_away(late_ns: int, taken: int) -> None:
    _, core = seated()
    port = Waited(*((b"noise", "an unauthenticated peer", 0) for _ in range(3000)))
    path = path_of(port, core)
    path.drain(0, late_ns)
    assert (path.received, len(port.buffer)) == (taken, 3000 - taken)


def test_a_drain_ahead_of_a_step_leaves_to_that_at_the_step_what_it_has_no_time_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, core = seated()
    port = Waited(*((b"noise", "an unauthenticated peer", 0) for _ in range(100)))
    path = path_of(port, core)
    readings = count(1)
    monkeypatch.setattr(datagram_path, "time", SimpleNamespace(monotonic_ns=lambda: next(readings) * MS))
    path.drain(0, 0, 3 * MS)
    taken = 100 - len(port.buffer)
    assert (
        taken == path.received == 4 * datagram_path.EARLY_CLOCK_EVERY - 1
    )  # the fourth reading is after the step is due
    assert path.cut_short == 0  # nothing is left out
    path.drain(3 * MS)
    assert (path.received, len(port.buffer), path.cut_short) == (100, 0, 0)


@pytest.mark.parametrize("away_s", [0.5, 2.5, 9.0])
def test_people_have_time_to_answer_a_server_that_was_away(away_s: float) -> None:
    """It heard nobody meanwhile, and they have heard nothing: whoever is there resumes at its first answer."""
    desk = Guarded(room(people=("anna", "ben")))
    anna = desk.welcome("anna", name="anna", nonce=1)
    watcher = desk.welcome("watcher", token="o", role="observer", nonce=2)
    seat, slots = desk.core.rooms[0].seats[0], desk.core.rooms[0].observer_slots
    desk.now_ns += round(away_s * 1e9)
    desk.core.tick(desk.core.rooms[0], desk.now_ns, round(away_s * 128))
    assert (seat.state, seat.session, len(slots.observers)) == ("seated", anna.session, 1)
    desk.now_ns += LOST_NS
    desk.core.tick(desk.core.rooms[0], desk.now_ns)
    assert seat.state == "seated"
    desk.now_ns += 1
    desk.core.receive(encode(Heartbeat(watcher.session, Stamp(1))), "watcher", desk.now_ns)
    desk.core.tick(desk.core.rooms[0], desk.now_ns)
    assert (seat.state, len(slots.observers)) == ("free", 1), "and not more than whoever falls silent"
    assert desk.core.dropped == {"seat timed out": 1}


def test_a_server_that_is_late_by_less_gives_no_more_time() -> None:
    desk = Guarded(room())
    desk.welcome("anna", name="anna", nonce=1)
    desk.now_ns += LOST_NS + 1
    desk.core.tick(desk.core.rooms[0], desk.now_ns, round(QUIET_NS * 1e-9 * 128) - 1)
    assert desk.core.rooms[0].seats[0].state == "free"
