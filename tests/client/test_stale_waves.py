"""Waves that keep the force: a wave that is newer than all before, or one that is played in its time (SPEC 4.2)."""

from collections.abc import Callable

import pytest

from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Heartbeat, Stamp, Waves
from cogrip.protocol.wire.session import STALE_NS

from tests.client.seated_client import DEVICE_HZ, Client, M, at_ns

Say = Callable[[Client, int, int], None]  # client, time, number of the frame


def receive(client: Client, now_ns: int, number: int, axes: int = 1) -> None:
    """One frame alone, of whatever number."""
    row = (0.0,) * axes
    message = Waves(client.session, number, (-0.3,) * axes, row, row, 0.0, 0.0, 0, Stamp(now_ns + 1), row * 2)
    client.core.receive(messages.encode(message), now_ns)


def beat(client: Client, now_ns: int, number: int) -> None:
    client.core.receive(messages.encode(Heartbeat(client.session, Stamp(now_ns + 1))), now_ns)


def begun_late(client: Client, now_ns: int, number: int) -> None:
    """A line whose frame 0 came at tick 1024."""
    receive(client, now_ns, number - 128)


def unfit(client: Client, now_ns: int, number: int) -> None:
    """Receive a message of this session, well formed, but not of this line: two axes."""
    receive(client, now_ns, number, axes=2)


def stream(client: Client, ticks: range, say: Say = receive) -> list[str]:
    """One datagram a frame, and the states that safety was in."""
    states = []
    for number in ticks:
        if number % M == 0:
            say(client, at_ns(number), number // M)
        client.tick(number, 0.0)
        states.append(client.core.safety.state)
    return states


NOTHING_NEW: dict[str, Say] = {
    "unfit": unfit,
    "again and again": lambda client, now_ns, number: receive(client, now_ns, 63),
    "long ago": lambda client, now_ns, number: receive(client, now_ns, number % 64),
    "heartbeats": beat,
}


@pytest.fixture
def client() -> Client:
    """Return a client that has heard 64 frames."""
    client = Client()
    assert set(stream(client, range(512))) == {"live"}
    return client


@pytest.mark.parametrize("kind", NOTHING_NEW)
def test_only_what_is_new_keeps_the_force(client: Client, kind: str) -> None:
    """A server that answers, but sends no new wave, is as good as silent: for the force, not for the seat."""
    states = stream(client, range(512, 2048), NOTHING_NEW[kind])
    stale = 504 + STALE_NS * DEVICE_HZ // 10**9 - 512
    assert set(states[:stale]) == {"live"}
    assert set(states[stale + 1 :]) == {"degraded"}
    assert client.core.force_n == (0.0,)
    assert client.core.session.state == "seated", "it answers"
    assert set(stream(client, range(2048, 2560))) == {"live"}, "force comes back with the first wave"


def test_waves_that_come_too_late_are_new_all_the_same(client: Client) -> None:
    """A delay that has grown beyond the playout delay: nothing is in time at first, and the force stays."""

    def late(client: Client, now_ns: int, number: int) -> None:
        receive(client, now_ns, number - 8 if number >= 72 else 0)

    assert set(stream(client, range(512, 1024), late)) == {"live"}
    assert client.waves.count().late > 8


def test_what_is_in_hand_and_played_in_its_time_keeps_the_force() -> None:
    """A path with so much jitter that frames come in clumps: 24 at once, every 187 ms, to a playout of 32 frames."""

    def clumps(client: Client, now_ns: int, number: int) -> None:
        for one in range(max(0, number - 24), number) if number % 24 == 0 else ():
            receive(client, now_ns, one)

    client = Client(frames=32)
    states = stream(client, range(2048), clumps)
    assert client.waves.count().late == client.waves.count().lost == 0
    assert set(states[512:]) == {"live"}
    states = stream(client, range(2048, 4096), lambda client, now_ns, number: None)
    assert states[-1] == "degraded", "nothing is in hand any more"


def test_a_number_far_ahead_takes_no_force(client: Client) -> None:
    """Nothing that comes later is newer than all before; it is played in its time all the same."""
    receive(client, at_ns(511), 2000)
    assert set(stream(client, range(512, 2048))) == {"live"}


def test_before_the_first_wave_a_server_that_is_there_is_enough() -> None:
    """The server sends heartbeats until it has received the hand's waves; an unfit message is no sign of that."""
    there, mute = Client(), Client()
    assert set(stream(there, range(1024), beat)) == {"live"}
    assert set(stream(there, range(1024, 1100), begun_late)) == {"live"}
    assert set(stream(mute, range(1024), unfit)[110:]) == {"degraded"}
    assert mute.core.session.dropped["unfit"] == 127, "all but that before the first tick"


def test_a_new_line_has_until_its_first_wave(client: Client) -> None:
    client.core.session.state = "resuming"  # as if it had been silent
    client.renew(at_ns(511))
    assert set(stream(client, range(512, 1024), beat)) == {"live"}
    assert set(stream(client, range(1024, 1536), begun_late)) == {"live"}
    assert stream(client, range(1536, 2048), beat)[-1] == "degraded"
