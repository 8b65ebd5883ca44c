"""Tickets, observers, being kicked, and a server that goes on from a checkpoint: the core, message by message."""

from itertools import count

import msgspec
import numpy as np
import pytest

from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Heartbeat, Hello, Leave, Person, Stamp, View, Welcome
from cogrip.protocol.wire.session import LOST_NS, QUIET_NS
from cogrip.server.admission.admission import AdmissionServices, Denied, Grant
from cogrip.server.admission.roster import roster_of
from cogrip.server.checkpoint import decode, encode
from cogrip.server.core import FAREWELL_EVERY_NS
from cogrip.server.inputs import Expire, Kick, Restore, Revoke, Stop
from cogrip.server.room import RESERVED_NS

from tests.server.test_server_core import Desk, hello, room, waves


class Tokens:
    """Answers by the token's first letter; remembers what was used."""

    def __init__(self) -> None:
        self.used: list[str] = []
        self.reads = False

    def admit(self, hello: Hello) -> Grant | Denied | None:
        if self.reads:
            return None
        made = {
            "p": Grant("player", "aaaaaaaa"),
            "o": Grant("observer", "bbbbbbbb"),
            "b": Grant("player", "cccccccc", user="ben"),
            "d": Grant("player", "dddddddd", device="hid:"),
            "f": Grant("player", "ffffffff", force_n=3.0, speed_mps=0.5),
            "r": Grant("player", "eeeeeeee", room="hall"),
        }
        return made.get(hello.token[:1], Denied("token", "this token is not known; ask for a new link"))

    def shown(self, hello: Hello) -> str | None:
        grant = self.admit(hello)
        return grant.token if isinstance(grant, Grant) else None

    def admitted(self, grant: Grant) -> None:
        self.used.append(grant.token)


class Guarded(Desk):
    """A desk that asks for tokens and gives tickets, each called ticket-1, ticket-2 ... after `server`."""

    token = "p"

    def __init__(self, *rooms: Settings, server: str = "") -> None:
        self.authenticator, tickets = Tokens(), count(1)
        new_ticket = lambda: f"{server}ticket-{next(tickets)}"  # noqa: E731
        super().__init__(
            *rooms,
            services=AdmissionServices(count(100).__next__, self.authenticator, new_ticket, "hash of {}".format),
        )
        self.now_ns = 1_000_000_000

    def leave(self, address: str, player: Welcome) -> None:
        self.say(messages.encode(Leave(player.session, "goodbye")), address)


@pytest.fixture
def desk() -> Guarded:
    return Guarded()


def test_a_hello_while_tokens_are_read_is_not_answered_and_comes_again(desk: Guarded) -> None:
    desk.authenticator.reads = True
    asked = messages.padded(hello(token="p"))
    assert desk.say(asked, "x") == []
    assert desk.core.dropped == {"hello not judged yet": 1}
    assert desk.authenticator.used == []
    desk.authenticator.reads = False
    (welcome,) = desk.say(asked, "x")
    assert isinstance(welcome, Welcome)


@pytest.mark.parametrize(
    ("changed", "code", "words"),
    [
        ({"token": ""}, "token", "not known"),
        ({"token": "x"}, "token", "not known"),
        ({"token": "b", "name": "anna"}, "name", "for the seat of 'ben', not of 'anna'"),
        ({"token": "d"}, "device", "this token is for hid:, and sim:ideal is claimed"),
        (
            {"token": "f", "force_n": 3.01, "speed_mps": 0.5},
            "device",
            "for devices of at most 3 N, and sim:ideal claims 3.01 N",
        ),
        (
            {"token": "f", "force_n": 3.0, "speed_mps": 0.51},
            "device",
            "of at most 0.5 m/s, and sim:ideal claims 0.51 m/s",
        ),
        (
            {"token": "f"},
            "device",
            "for devices of at most 3 N, and sim:ideal claims no bound; join with a weaker device",
        ),
        ({"token": "r"}, "room", "no room 'hall'"),
        ({"token": "r", "room": "lab"}, "room", "for room 'hall', not 'lab'"),
    ],
)
def test_a_hello_without_admission_is_refused_in_words(
    desk: Guarded, changed: dict[str, object], code: str, words: str
) -> None:
    refuse = desk.refused("x", **changed)
    assert refuse.code == code
    assert words in refuse.reason
    assert desk.core.events[-1].code == code
    assert not desk.authenticator.used
    assert not desk.core.knows("x")


def test_a_device_at_the_bounds_of_its_token_is_seated(desk: Guarded) -> None:
    assert desk.welcome("x", token="f", force_n=3.0, speed_mps=0.5).role == "player"


def test_a_token_is_used_when_its_seat_is_given_and_only_then(desk: Guarded) -> None:
    assert desk.welcome("x", token="b").settings.user == "ben"
    assert desk.authenticator.used == ["cccccccc"]
    desk.hello("x", token="b")  # the welcome was lost
    assert desk.refused("y", token="b", nonce=2).code == "taken"
    assert desk.authenticator.used == ["cccccccc"]


def test_a_seat_is_resumed_from_another_address_with_the_same_session(desk: Guarded) -> None:
    first = desk.welcome("x")
    desk.say(waves(first.session, 0, 0.1), "x")
    desk.tick()
    port = desk.core.rooms[0].seats[0].port
    desk.core.outbox.clear()
    again = desk.welcome("y", ticket=first.ticket, nonce=1)
    assert (again.session, again.ticket, again.settings) == (first.session, first.ticket, first.settings)
    assert desk.core.rooms[0].seats[0].port is port  # the line goes on
    assert desk.core.knows("y")
    assert not desk.core.knows("x")
    desk.core.receive(waves(first.session, 1, 0.1), "x", desk.now_ns)
    assert desk.core.dropped["not seated"] == 1
    desk.tick()
    assert desk.heard("y")
    assert not desk.heard("x")


def test_a_client_that_was_silent_too_long_resumes_with_a_new_line(desk: Guarded) -> None:
    first = desk.welcome("x")
    desk.say(waves(first.session, 0, 0.1), "x")
    desk.now_ns += LOST_NS
    desk.tick()
    assert not desk.core.knows("x")
    again = desk.welcome("x", ticket=first.ticket)
    assert again.session != first.session
    assert again.ticket == first.ticket
    assert desk.core.rooms[0].seats[0].port.origin is None  # type: ignore[union-attr]


@pytest.mark.parametrize("how", ["leave", "kick", "stop", "revoke"])
def test_a_ticket_is_void_after_the_end(desk: Guarded, how: str) -> None:
    first = desk.welcome("x")
    ends = {
        "leave": lambda: desk.leave("x", first),
        "kick": lambda: desk.core.handle(Kick("anna"), desk.now_ns),
        "stop": lambda: desk.core.handle(Stop("over"), desk.now_ns),
        "revoke": lambda: desk.core.handle(Revoke(("aaaaaaaa",)), desk.now_ns),
    }
    ends[how]()
    desk.refused("y", ticket=first.ticket, token="x")
    if how != "stop":
        desk.welcome("y", ticket=first.ticket, token="b", name="ben")  # it is no bar to a good token


@pytest.mark.parametrize(
    ("token", "role"), [("o", "observer"), ("b", "player"), ("", "refused"), ("x", "refused"), ("p", "resumed")]
)
def test_a_ticket_has_no_rights_but_those_of_the_token_it_was_given_for(desk: Guarded, token: str, role: str) -> None:
    first = desk.welcome("x", name="anna")
    answer = desk.hello("y", ticket=first.ticket, token=token, nonce=2, name="")
    if role == "resumed":
        assert isinstance(answer, Welcome)
        assert (answer.session, answer.role) == (first.session, "player")
        return
    assert desk.core.dropped["ticket without its token"] == 1
    assert desk.core.knows("x"), "its holder keeps the seat"
    assert ("refused" if isinstance(answer, messages.Refuse) else answer.role) == role  # type: ignore[union-attr]
    assert getattr(answer, "session", 0) != first.session
    desk.welcome("z", ticket=first.ticket, token="p", nonce=3)


def test_an_observers_ticket_needs_its_token_too(desk: Guarded) -> None:
    seen = desk.welcome("o", token="o")
    other = desk.welcome("p", token="p", ticket=seen.ticket, role="observer", nonce=2)
    assert other.session != seen.session
    assert desk.core.knows("o")


DEVICE = "replay:/var/lab/2026/anna/the third of the runs#user=anna&start_s=2"


@pytest.mark.parametrize(
    "changed", [{"device": f"{DEVICE}5"}, {"force_n": 9.0}, {"speed_mps": 9.0}, {"axes": 2}, {"rate_hz": 2e3}]
)
def test_a_ticket_opens_a_seat_for_its_device_record_alone(desk: Guarded, changed: dict[str, object]) -> None:
    """All of an address counts, however long."""
    first = desk.welcome("x", device=DEVICE)
    assert desk.core.events[-1].text.endswith(f"with {DEVICE}")
    assert [each.device for each in roster_of(desk.core.rooms, desk.now_ns)] == [DEVICE]
    assert desk.refused("y", ticket=first.ticket, token="p", **{"device": DEVICE, **changed}).code == "device"
    assert desk.core.knows("x")
    desk.welcome("y", ticket=first.ticket, device=DEVICE)


def test_kicked_by_name_and_room_with_the_reason_on_both_sides() -> None:
    desk = Guarded(room("lab"), room("hall"))
    here, there = desk.welcome("x", room="lab"), desk.welcome("y", room="hall", nonce=2)
    assert desk.core.handle(Kick("zoe"), desk.now_ns) == 0
    assert desk.core.handle(Kick("anna", "hall", "too rough"), desk.now_ns) == 1
    (farewell,) = desk.heard("y")
    assert isinstance(farewell, Farewell)
    assert farewell.session == there.session
    assert farewell.reason == "kicked by the administrator: too rough"
    assert [each.text for each in desk.core.events if each.event == "kicked"] == [
        "hall: anna was kicked by the administrator: too rough"
    ]
    assert desk.core.knows("x")
    assert here.session == desk.core.rooms[0].seats[0].session


def test_a_revoked_token_ends_what_was_taken_with_it(desk: Guarded) -> None:
    desk.welcome("x")
    desk.welcome("y", token="b", nonce=2)
    desk.welcome("z", token="o", nonce=3)
    assert desk.core.handle(Revoke(("bbbbbbbb", "cccccccc", "ffffffff")), desk.now_ns) == 2
    assert [desk.core.knows(each) for each in "xyz"] == [True, False, False]
    assert desk.core.handle(Revoke(("",)), desk.now_ns) == 0


def test_an_observer_sees_the_object_and_who_holds_it(desk: Guarded) -> None:
    player = desk.welcome("x")
    seen = desk.welcome("o", token="o", nonce=2)
    assert seen.role == "observer"
    assert seen.settings.user == "observer 1"
    views = []
    for number in range(8):
        desk.say(waves(player.session, number, 0.5), "x")
        views += desk.say(messages.encode(Heartbeat(seen.session, Stamp(desk.now_ns))), "o")
        desk.tick()
    views += desk.heard("o")
    people = [each for each in views if isinstance(each, Person)]
    views = [each for each in views if isinstance(each, View)]
    assert len(views) == 4  # every second step at 128 Hz
    assert [(each.seat, each.name, each.state) for each in people] == [(0, "anna", "live")] * 4
    assert people[-1].lost == 0
    assert views[-1].seats == (0,)
    assert views[-1].object[0] == desk.core.rooms[0].world.position[0]
    assert views[-1].proxies_m == tuple(desk.core.rooms[0].world.proxy(0).tolist())


def test_an_observer_that_sends_waves_is_kicked_and_nothing_moves(desk: Guarded) -> None:
    player, seen = desk.welcome("x"), desk.welcome("o", token="o", nonce=2)
    desk.say(waves(player.session, 0, 0.0), "x")
    desk.tick()
    desk.core.outbox.clear()
    (farewell,) = desk.say(waves(seen.session, 0, 5.0), "o")
    assert isinstance(farewell, Farewell)
    assert "an observer may not send waves" in farewell.reason
    assert desk.core.dropped["observer's waves"] == 1
    assert desk.core.events[-1].event == "kicked"
    desk.tick()
    assert desk.core.rooms[0].world.position[0] == 0.0
    desk.refused("o", ticket=seen.ticket, token="x")


def test_places_for_observers_are_counted_per_room() -> None:
    desk = Guarded(room(admission={"observers": 1}))
    first = desk.welcome("o", token="o")
    refuse = desk.refused("p", token="o", nonce=2)
    assert refuse.code == "full"
    assert "all 1 places for observers" in refuse.reason
    desk.leave("o", first)
    desk.welcome("p", token="o", nonce=2)
    desk.now_ns += LOST_NS
    desk.tick()
    assert not desk.core.knows("p")
    desk.welcome("q", ticket="ticket-1", token="o")


def test_a_player_may_observe_on_request_and_resumes_from_another_address(desk: Guarded) -> None:
    first = desk.welcome("x", role="observer")
    again = desk.welcome("p", ticket=first.ticket)
    assert (again.session, first.role, again.role) == (first.session, "observer", "observer")
    assert desk.core.knows("p")
    assert not desk.core.knows("x")
    assert not any(seat.port for seat in desk.core.rooms[0].seats)


def moved() -> tuple[Guarded, Welcome]:
    desk = Guarded()
    player = desk.welcome("x", name="anna")
    desk.push("x", player.session, 40, 0.4)
    desk.core.outbox.clear()
    assert desk.core.rooms[0].world.position[0] > 1e-3
    return desk, player


def restored(before: Guarded, server: str = "") -> Guarded:
    """Return a server that goes on from the other's checkpoint. server: before the tickets of its own."""
    after = Guarded(server=server)
    (checkpoint,) = before.core.checkpoint()
    after.core.handle(Restore(decode(encode(checkpoint))), after.now_ns)
    return after


def test_a_server_goes_on_where_another_ended() -> None:
    before, player = moved()
    after = restored(before)
    here, there = after.core.rooms[0], before.core.rooms[0]
    assert here.world.position.tolist() == there.world.position.tolist()
    assert not here.world.velocity.any()
    assert (here.steps, here.travel_m) == (there.steps, there.travel_m)
    assert after.core.events[-1].event == "restored"
    # kept for whoever had it: another gets the next seat, and none by that name
    assert after.refused("s", name="anna", nonce=9, token="p").code == "taken"
    again = after.welcome("x", ticket=player.ticket)
    assert again.settings.user == "anna"
    after.push("x", again.session, 1, 0.0)
    assert here.world.force.tolist() == [[0.0], [0.0]]  # no spring, no kick
    assert here.world.position.tolist() == there.world.position.tolist()


@pytest.mark.parametrize("expired", [False, True])
def test_a_seat_of_a_checkpoint_is_kept_for_so_long_and_while_its_token_is_good(expired: bool) -> None:
    before, player = moved()
    after = restored(before, "another-")  # the two servers' own tickets differ
    after.now_ns += RESERVED_NS - 1
    assert after.refused("s", name="anna", token="p").code == "taken"
    if expired:
        after.core.handle(Expire(("aaaaaaaa",)), after.now_ns)
        after.refused("x", ticket=player.ticket, token="x")
    else:
        after.now_ns += 1
    after.welcome("s", name="anna")
    after.refused("x", ticket=player.ticket, token="x")


def test_a_refusal_says_how_many_seats_are_reserved_and_for_how_long() -> None:
    before, _ = moved()
    before.welcome("y", name="ben", nonce=2)
    after = restored(before)
    after.now_ns += RESERVED_NS // 2
    refuse = after.refused("s", token="p")
    kept = "kept for another 3 s for someone who lost their connection; try again then"
    assert (refuse.code, refuse.reason) == ("full", f"the room has no free seat: 0 taken, 2 {kept}")
    refuse = after.refused("s", token="p", name="anna")
    assert (refuse.code, refuse.reason) == ("taken", f"the seat of 'anna' is {kept}")
    after.welcome("x", ticket="ticket-1", nonce=5)
    assert after.refused("s", token="p").reason == f"the room has no free seat: 1 taken, 1 {kept}"
    assert after.refused("s", token="p", name="anna").reason.startswith("the seat of 'anna' is taken")


def test_a_seat_whose_person_is_silent_is_kept_until_they_are_lost() -> None:
    desk = Guarded(room(people=("anna",)))
    desk.welcome("x")
    assert desk.refused("s", token="p").reason == "the room is full: all 1 seats are taken"
    desk.now_ns += QUIET_NS
    reason = desk.refused("s", token="p").reason
    assert "0 taken, 1 kept for another 2 s" in reason
    assert "anna" not in reason


def test_the_farewell_of_a_seat_that_was_ended_is_repeated_while_it_sends(desk: Guarded) -> None:
    """Else a lost farewell would undo a kick: the client would fall silent, and come back by its token."""
    player = desk.welcome("x")
    desk.core.handle(Kick("anna", reason="too rough"), desk.now_ns)
    (first,) = desk.heard("x")
    for number in range(20):
        desk.now_ns += FAREWELL_EVERY_NS // 4
        desk.core.receive(waves(player.session, number, 0.1), "x", desk.now_ns)
    assert desk.heard("x") == [first] * 5


def test_hellos_have_a_budget(desk: Guarded) -> None:
    for nonce in range(20):
        desk.core.receive(messages.padded(hello(token="p", nonce=nonce + 1)), "x", desk.now_ns)
    assert desk.core.dropped["hello budget"] >= 10
    for nonce in range(100):
        desk.core.receive(messages.padded(hello(token="o", nonce=nonce + 1)), "o", desk.now_ns)
    assert len(desk.core.roster()) == 2
    first = desk.welcome("y", name="ben", nonce=77)
    for nonce in range(20):
        again = messages.padded(hello(nonce=nonce + 1, ticket=first.ticket, token="p"))
        desk.core.receive(again, f"z{nonce}", desk.now_ns)
    assert sum(event.event == "resumed" for event in desk.core.events) == 8


def test_an_address_that_changed_seats_keeps_the_new_one(desk: Guarded) -> None:
    first = desk.welcome("x", name="anna")
    desk.leave("x", first)
    second = desk.welcome("x", name="ben", nonce=2)
    desk.welcome("y", name="anna", nonce=3)
    assert desk.core.knows("x")
    desk.say(waves(second.session, 0, 0.1), "x")
    assert "not seated" not in desk.core.dropped


def test_taking_the_seat_anew_brings_in_no_more_power() -> None:
    desk = Guarded(room(admission={"power_w": 0.01}))
    player = desk.welcome("x")
    here, number, brought_j = desk.core.rooms[0], 0, 0.0
    for frame in range(1, 1281):
        if frame % 5 == 0:
            brought_j += here.world.port_work[0]
            player, number = desk.welcome("x", nonce=frame), 0
        desk.core.receive(waves(player.session, number, 5.0), "x", desk.now_ns)
        number += 1
        desk.tick()
        desk.core.outbox.clear()
        if frame % 5 == 4:  # as often as it may
            desk.now_ns += 250_000_000
    seconds = (desk.now_ns - 1_000_000_000) * 1e-9
    assert 1e-3 < brought_j + here.world.port_work[0] <= 0.01 * (seconds + 0.25) + 1e-3


def test_a_hand_that_is_nowhere_blinds_no_observer(desk: Guarded) -> None:
    player, seen = desk.welcome("x"), desk.welcome("o", token="o", nonce=2)
    far = messages.decode(waves(player.session, 0, 0.1))
    desk.core.receive(messages.encode(msgspec.structs.replace(far, state=(5000.0, 5000.0))), "x", desk.now_ns)
    assert desk.core.dropped["unfit"] == 1
    desk.say(waves(player.session, 0, 0.1), "x")
    desk.tick()
    desk.core.rooms[0].world.offset[0] = 5000.0
    for _ in range(4):
        desk.tick()
    views = [each for each in desk.heard("o") if isinstance(each, View)]
    assert views[0].session == seen.session
    assert views[0].proxies_m == (1000.0,)


def test_an_object_that_was_thrown_out_is_put_back_when_nobody_is_left(desk: Guarded) -> None:
    player = desk.welcome("x")
    desk.say(waves(player.session, 0, 0.1), "x")
    desk.core.rooms[0].world.position = np.array([7.0])
    desk.tick()
    assert [body.what for body in desk.core.rooms[0].left] == ["the object"]
    desk.leave("x", player)
    desk.tick()
    assert desk.core.rooms[0].world.position[0] == 0.0
    assert desk.core.rooms[0].left, "of this run it stays so"
    assert desk.core.rooms[0].unstable == ""


def test_a_seat_session_begins_with_an_empty_energy_ledger(desk: Guarded) -> None:
    """After a year of work the ledger of the next session is as exact as that of the first."""
    player, here = desk.welcome("x"), desk.core.rooms[0]
    desk.push("x", player.session, 64, 0.3)
    assert here.world.port_work_j()[0] != 0.0
    here.world.port_work = np.array([3e7 / 7.0, 1.0])
    desk.core.outbox.clear()
    desk.leave("x", player)
    desk.welcome("x", nonce=2)
    assert list(here.world.port_work_j()) == [0.0, 1.0], "and nobody else's are touched"


def test_a_client_whose_waves_do_not_fit_counts_as_silent() -> None:
    """Waves that do not fit keep no seat; heartbeats do: a device may take long to open."""
    desk = Guarded(room(people=("anna", "ben", "carl")))
    fits, unfit, waits = [desk.welcome(name, name=name, nonce=n) for n, name in enumerate(("anna", "ben", "carl"), 1)]
    for number in range(2 * 128 + 16):
        desk.core.receive(waves(fits.session, number, 0.1), "anna", desk.now_ns)
        desk.core.receive(waves(unfit.session, number, 0.1, 0.1), "ben", desk.now_ns)  # two axes
        desk.core.receive(messages.encode(Heartbeat(waits.session, Stamp(1))), "carl", desk.now_ns)
        desk.tick()
        desk.core.outbox.clear()
    assert desk.states == ["seated", "free", "seated"]
    assert desk.core.dropped["unfit"] > 250
    assert desk.core.dropped["seat timed out"] == 1


def test_one_token_holds_so_many_seats_at_once_in_all_rooms() -> None:
    users = [{"name": name} for name in ("anna", "ben", "cleo", "dora")]
    rooms = [room(name=name, users=users, admission={"seats_per_token": 3}) for name in ("lab", "annex")]
    desk = Guarded(*rooms)
    desk.welcome("a", room="lab", name="")
    desk.welcome("b", room="annex", name="")
    first = desk.welcome("c", room="annex", name="")
    refuse = desk.refused("d", token="p", room="lab", name="")
    assert refuse.code == "token"
    assert "holds 3 seats already (admission.seats_per_token)" in refuse.reason
    desk.welcome("e", token="b", room="lab", name="ben")
    desk.leave("c", first)
    desk.welcome("f", room="lab", name="")


def test_a_ticket_opens_no_more_seats_than_its_token_may_hold() -> None:
    desk = Guarded(room(people=("anna", "ben"), admission={"seats_per_token": 1}))
    first = desk.welcome("x", name="anna")
    desk.now_ns += LOST_NS
    desk.tick()
    second = desk.welcome("y", name="ben", nonce=2)
    refuse = desk.refused("x", ticket=first.ticket, token="p")
    assert (refuse.code, "holds 1 seats already" in refuse.reason) == ("token", True)
    desk.welcome("z", ticket=second.ticket)  # of a seat that is held it moves the session
    desk.leave("z", second)
    desk.welcome("x", ticket=first.ticket)


@pytest.mark.parametrize("token", ["p", "o"])
def test_an_expired_token_ends_the_right_to_resume_and_no_session(desk: Guarded, token: str) -> None:
    first, ben = desk.welcome("x", token=token), desk.welcome("b", token="b", name="ben", nonce=2)
    desk.core.handle(Expire(("aaaaaaaa", "bbbbbbbb")), desk.now_ns)
    assert desk.core.knows("x"), "whoever has a place keeps it"
    assert desk.refused("y", ticket=first.ticket, token="x").code == "token", "the hello is judged by its token"
    desk.welcome("z", ticket=ben.ticket, token="b")  # another token's ticket is as good as before
