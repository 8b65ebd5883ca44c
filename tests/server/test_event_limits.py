"""Events that unauthenticated peers can bring about: a log gets a bounded number of lines, and the rest as a count."""

import time

import pytest

from cogrip.machine.stop import Stop
from cogrip.server.admission.admission import AdmissionServices
from cogrip.server.core import ServerCore
from cogrip.server.events import EVENTS, UNAUTHENTICATED_EVENTS, ServerEvent
from cogrip.server.io.loop import REPORTED, LiveServer
from cogrip.server.rate_limit import RateLimiter
from cogrip.server.unencrypted_channel import UnencryptedListener

FLOOD = 1024


@pytest.mark.parametrize("event", UNAUTHENTICATED_EVENTS)
def test_a_flood_of_events_becomes_some_lines_and_a_count(event: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[ServerEvent] = []
    server = LiveServer(
        [], "127.0.0.1", 0, Stop(), said.append, lambda core: UnencryptedListener(RateLimiter(b"s"), core.knows)
    )
    server.core = ServerCore([], "", AdmissionServices(lambda: 1))  # type: ignore[assignment]
    server.channel = UnencryptedListener(RateLimiter(b"s"), server.core.knows)
    now_ns = 5_000_000_000
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    for each in range(FLOOD):
        server.core.events.append(ServerEvent(event, f"number {each}"))
    server._report()
    assert len(said) == REPORTED.burst
    now_ns += 1_000_000_000
    server._report()
    assert said[REPORTED.burst :] == [
        ServerEvent(event, f"{FLOOD - REPORTED.burst} more of this kind ({event}) were not said one by one")
    ]


def test_only_what_the_administrator_and_the_server_itself_do_is_said_every_time() -> None:
    assert set(EVENTS) - set(UNAUTHENTICATED_EVENTS) == {"restored", "reloaded", "opened", "closed", "trouble"}
