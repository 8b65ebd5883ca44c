"""Orders of administrators that change a hand: two at once, and a server that is killed behind one."""

from pathlib import Path

import pytest

from cogrip.machine.stop import Stop
from cogrip.protocol.settings.hand import parsed
from cogrip.protocol.settings.room import resolve
from cogrip.server.administration.orders import Request, SetHandOrder
from cogrip.server.checkpoint import decode
from cogrip.server.inputs import SetHand as HandSet
from cogrip.server.io import checkpoint_file
from cogrip.server.io.hand_orders import AwaitedOrders
from cogrip.server.io.housekeeping import POLL_EVERY_NS, Housekeeping
from cogrip.server.io.loop import LiveServer
from cogrip.server.io.state_folder import make_folder
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener
from cogrip.sim.laboratory import Laboratory


@pytest.fixture
def laboratory() -> Laboratory:
    found = Laboratory(
        resolve({"seconds": 2.0, "object": {"axes": 3}, "link": {"delay_ms": 20.0}, "users": [{"name": "anna"}]})
    )
    for _ in range(64):
        found.frame()
    return found


def order(*pairs: str) -> SetHandOrder:
    return SetHandOrder("anna", parsed(pairs))


def test_two_administrators_at_once_are_both_told_what_holds(laboratory: Laboratory) -> None:
    """The second changes a scale that the first has set, before the client has answered: the first was taken as well."""
    said: list[tuple[str, bool]] = []
    orders = AwaitedOrders(laboratory.server, lambda request, text, ok: said.append((text, ok)))
    caller: Request = None  # type: ignore[assignment]  # goes back with the answer
    for pairs in (("position_scale=3", "gravity_compensation=on"), ("position_scale=3",), ("position_scale=5",)):
        orders.obey(caller, order(*pairs), laboratory.now_ns)
    for _ in range(32):
        laboratory.frame()
        orders.poll(laboratory.now_ns)
    assert [ok for _, ok in said] == [False, True, True]
    assert said[0][0].startswith("anna did not take gravity_compensation (")
    assert all("position_scale=5 " in text for text, _ in said)


def test_the_next_server_knows_the_scale_that_was_set_last(laboratory: Laboratory, tmp_path: Path) -> None:
    """Its checkpoint does not wait for its turn: else the client's waves would be clipped from then on."""
    folder = make_folder(tmp_path / "state")
    server = LiveServer(
        [], "127.0.0.1", 0, Stop(), print, lambda core: UnencryptedListener(RateLimiter(b"s"), core.knows)
    )
    server.core = laboratory.server
    housekeeping = Housekeeping(server, print, folder=folder)
    housekeeping.begin()
    housekeeping.chore(laboratory.now_ns)
    assert laboratory.server.handle(HandSet("anna", order("position_scale=10").change), laboratory.now_ns) == 1
    housekeeping.chore(laboratory.now_ns + POLL_EVERY_NS)
    housekeeping.end(said_goodbye=False)
    kept = checkpoint_file.read(folder.checkpoint(laboratory.room.name))
    assert kept is not None
    assert decode(kept).seats[0].tool == laboratory.room.seats[0].hand.wanted
    assert laboratory.room.seats[0].hand.wanted.position_scale == 10.0
