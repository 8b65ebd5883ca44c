"""Observer: the newest view wins, the place is kept, and whatever does not fit is counted."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client import inputs
from cogrip.client.observer import ObserverCore
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Heartbeat, Hello, Leave, Stamp, View, Waves
from cogrip.protocol.wire.session import HEARTBEAT_EVERY_NS, QUIET_NS, ClientSession

from tests.client.seated_client import hello, seat, welcome

MS = 1_000_000
SEAT = msgspec.structs.replace(seat(), user="observer 1")


def view(number: int, session: int = 5, seats: tuple[int, ...] = (0,), axes: int = 1, sent_ns: int = 1) -> bytes:
    row = (0.001 * number,) * axes
    shown = View(session, number, row * 2, seats, row * len(seats), row * len(seats), Stamp(sent_ns))
    return messages.encode(shown)


def looking(now_ns: int = 0) -> ObserverCore:
    core = ObserverCore(ClientSession(hello(nonce=7, device="none", rate_hz=1.0, role="observer")))
    core.handle(inputs.Connect(), now_ns)
    core.receive(welcome(SEAT, 5, nonce=7, role="observer"), now_ns)
    core.outbox.clear()
    assert core.session.state == "seated"
    return core


@pytest.fixture
def core() -> ObserverCore:
    return looking()


def test_the_newest_view_is_shown_with_its_age(core: ObserverCore) -> None:
    assert (core.view, core.age_ns(5)) == (None, None)
    core.receive(view(3), 10)
    assert core.view == messages.decode(view(3))
    assert (core.views, core.age_ns(25)) == (1, 15)


@given(st.permutations(range(8)))
def test_late_and_repeated_views_change_nothing(order: list[int]) -> None:
    core = looking()
    newest = -1
    for number in order:
        core.receive(view(number), 1)
        newest = max(newest, number)
        assert core.view is not None
        assert core.view.number == newest
    core.receive(view(newest), 2)
    assert core.session.dropped["late view"] == 9 - core.views


@pytest.mark.parametrize(
    "odd",
    [
        View(5, 9, (0.0, 0.0, 0.0), (), (), (), Stamp(1)),
        View(5, 9, (0.0, 0.0), (0, 1), (0.0,), (0.0, 0.0), Stamp(1)),
        View(5, 9, (0.0, 0.0), (0,), (0.0,), (), Stamp(1)),
    ],
)
def test_a_view_that_does_not_add_up_is_not_shown(core: ObserverCore, odd: View) -> None:
    core.receive(messages.encode(odd), 1)
    assert core.view is None
    assert core.session.dropped == {"unfit": 1}


def test_waves_are_not_for_it_and_garbage_is_counted(core: ObserverCore) -> None:
    waves = messages.encode(Waves(5, 0, (0.1,), (0.0,), (0.0,), 0.0, 0.0, 0, Stamp(1), (0.0, 0.0)))
    for datagram in (waves, b"garbage", view(1, session=6)):
        core.receive(datagram, 1)
    assert core.view is None
    assert core.session.dropped == {"unexpected": 1, "malformed": 1, "other session": 1}


def test_it_says_that_it_is_there_and_nothing_else(core: ObserverCore) -> None:
    for now_ns in range(0, 4 * HEARTBEAT_EVERY_NS, 20 * MS):
        core.receive(view(now_ns // MS), now_ns)
        core.handle(inputs.Poll(), now_ns)
    assert {type(messages.decode(datagram)) for datagram in core.outbox} == {Heartbeat}
    assert 3 <= len(core.outbox) <= 5
    core.handle(inputs.Leave("seen enough"), 10**9)
    assert isinstance(messages.decode(core.outbox[-1]), Leave)
    core.receive(messages.encode(Farewell(5, "goodbye")), 10**9)
    assert (core.session.state, core.session.failed) == ("closed", "")


def test_it_comes_back_and_sees_the_new_servers_views_from_their_first(core: ObserverCore) -> None:
    core.receive(view(1000), 0)
    core.handle(inputs.Poll(), QUIET_NS)
    [asked] = [messages.decode(datagram) for datagram in core.outbox]
    assert isinstance(asked, Hello)
    assert (asked.role, asked.ticket) == ("observer", "a-ticket")
    again = msgspec.structs.replace(SEAT, user="observer 2")
    core.receive(welcome(again, 6, nonce=7, role="observer"), QUIET_NS + 1)
    assert core.session.state == "seated"
    assert core.view is not None, "the old view stays until there is a new one"
    core.receive(view(3, session=6), QUIET_NS + 2)
    assert core.view.number == 3
