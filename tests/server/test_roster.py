"""The roster, as an administrator sees it."""

import msgspec

from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Heartbeat, Leave, Stamp
from cogrip.protocol.wire.session import ClientSession
from cogrip.server.administration.orders import OrderReply
from cogrip.server.admission.roster import MOST_LISTED, RosterEntry, roster_of
from cogrip.server.inputs import UnbindAddress
from cogrip.server.io.control import MOST_ANSWER_BYTES

from tests.protocol.two_ends import MS, exchange, hello, seated, waves

S = 1_000 * MS


def test_a_person_is_listed_from_joining_to_leaving() -> None:
    _, core = seated(now_ns=5 * S)
    [anna] = roster_of(core.rooms, 7 * S)
    assert anna == RosterEntry("anna", "lab", "anna's", 2.0, 0, "sim:phantom", None, None, None, 0, False)
    core.receive(waves(100), "anna's", 7 * S)
    core.tick(core.rooms[0], 7 * S)
    # our clock shows 7 s, theirs 107 s: 20 ms there and 10 ms back after 5 ms are told as 15 ms each
    core.receive(
        messages.encode(Heartbeat(100, Stamp(107 * S + 15 * MS, 7 * S - 10 * MS, 5 * MS))), "anna's", 7 * S + 15 * MS
    )
    [anna] = roster_of(core.rooms, 8 * S)
    assert (anna.rtt_ms, anna.up_ms, anna.down_ms, anna.holds, anna.since_s) == (20.0, 10.0, 10.0, True, 3.0)
    core.receive(messages.encode(Leave(100, "done")), "anna's", 8 * S)
    assert roster_of(core.rooms, 8 * S) == []


def test_an_observer_is_listed_behind_the_seats_and_who_lost_the_address_is_away() -> None:
    _, core = seated()
    looks = ClientSession(hello("", 9, role="observer"))
    looks.connect(0)
    exchange(looks, core, 0, "there")
    core.handle(UnbindAddress("anna's"), 90 * S)
    first, second = roster_of(core.rooms, 90 * S)
    assert (first.name, first.seat, first.address) == ("anna", 0, "away")
    assert second == RosterEntry("observer 1", "lab", "there", 90.0)


def test_a_list_as_long_as_may_be_has_room_in_an_answer() -> None:
    longest = RosterEntry("n" * 40, "r" * 40, "[fe80::1234:5678:9abc:def0%interface0]:65535", 1234567.8, 255, "\x01" * 40,
                      59999.999, 59999.999, 59999.999, 2**53, True, "", -1e14 / 3, 1e14 / 3, 1e14 / 3)  # fmt: skip
    assert len(msgspec.json.encode(OrderReply(True, "t" * 100, (longest,) * MOST_LISTED))) < MOST_ANSWER_BYTES
