"""Waves that keep the force: a wave that is newer than all before, or one that is played in its time (SPEC 4.2)."""

from collections.abc import Callable

import pytest

from cogrip.protocol import messages
from cogrip.protocol.messages import Heartbeat, Stamp, Waves
from cogrip.protocol.rates import due_ns
from cogrip.protocol.session import STALE_NS

from tests.client.seated_client import DEVICE_HZ, Client, M


def receive(client: Client, now_ns: int, number: int, wave: float = -0.3, session: int = 7) -> None:
    """One frame alone, of whatever number."""
    message = Waves(session, number, (wave,), (0.0,), (0.0,), 0.0, 0.0, 0, Stamp(now_ns + 1), (0.0, 0.0))
    client.core.receive(messages.encode(message), now_ns)


def unfit(client: Client, now_ns: int, number: int) -> None:
    """Return a message of this session, well formed, but not of this line: two axes."""
    message = Waves(7, number, (0.1, 0.1), (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0, Stamp(now_ns + 1), (0.0,) * 4)
    client.core.receive(messages.encode(message), now_ns)


def stream(client: Client, ticks: range, say: Callable[[int, int], None]) -> list[str]:
    """One datagram a frame, and the states that safety was in."""
    states = []
    for number in ticks:
        now_ns = due_ns(0, number, DEVICE_HZ)
        if number % M == 0:
            say(now_ns, number // M)
        client.tick(number, 0.0)
        states.append(client.core.safety.state)
    return states


NOTHING_NEW: dict[str, Callable[[Client], Callable[[int, int], None]]] = {
    "unfit": lambda client: lambda now_ns, number: unfit(client, now_ns, number),
    "again and again": lambda client: lambda now_ns, number: receive(client, now_ns, 63),
    "long ago": lambda client: lambda now_ns, number: receive(client, now_ns, number % 64),
    "heartbeats": lambda client: (
        lambda now_ns, number: client.core.receive(messages.encode(Heartbeat(7, Stamp(now_ns + 1))), now_ns)
    ),
}


@pytest.mark.parametrize("kind", NOTHING_NEW)
def test_only_what_is_new_keeps_the_force(kind: str) -> None:
    """A server that answers, but sends no new wave,, is as good as silent: for the force, not for the seat."""
    client = Client()
    assert set(stream(client, range(512), lambda now_ns, number: receive(client, now_ns, number))) == {"live"}
    states = stream(client, range(512, 2048), NOTHING_NEW[kind](client))
    stale = 504 + STALE_NS * DEVICE_HZ // 10**9 - 512
    assert set(states[:stale]) == {"live"}
    assert set(states[stale + 1 :]) == {"degraded"}
    assert client.core.force_n == (0.0,)
    assert client.core.session.state == "seated", "it answers"
    states = stream(client, range(2048, 2560), lambda now_ns, number: receive(client, now_ns, number))
    assert set(states) == {"live"}, "force comes back with the first wave"


def test_waves_that_come_too_late_are_new_all_the_same() -> None:
    """A delay that has grown beyond the playout delay: nothing is in time at first, and the force stays."""
    client = Client()
    stream(client, range(512), lambda now_ns, number: receive(client, now_ns, number))
    late = stream(
        client, range(512, 1024), lambda now_ns, number: receive(client, now_ns, number - 8 if number >= 72 else 0)
    )
    assert set(late) == {"live"}
    assert client.waves.count().late > 8


def test_what_is_in_hand_and_played_in_its_time_keeps_the_force() -> None:
    """A path with so much jitter that frames come in clumps: 24 at once, every 187 ms, to a playout of 32 frames."""
    client = Client(frames=32)

    def clumps(now_ns: int, number: int) -> None:
        if number % 24 == 0:
            for one in range(max(0, number - 24), number):
                receive(client, now_ns, one)

    states = stream(client, range(2048), clumps)
    assert client.waves.count().late == client.waves.count().lost == 0
    assert set(states[512:]) == {"live"}
    states = stream(client, range(2048, 4096), lambda now_ns, number: None)
    assert states[-1] == "degraded", "nothing is in hand any more"


def test_a_number_far_ahead_takes_no_force() -> None:
    """Nothing that comes later is newer than all before; it is played in its time all the same."""
    client = Client()
    stream(client, range(512), lambda now_ns, number: receive(client, now_ns, number))
    receive(client, due_ns(0, 511, DEVICE_HZ), 2000)
    states = stream(client, range(512, 2048), lambda now_ns, number: receive(client, now_ns, number))
    assert set(states) == {"live"}


def test_before_the_first_wave_a_server_that_is_there_is_enough() -> None:
    """The server sends heartbeats until it has received the hand's waves; an unfit message is no sign of that."""
    client, mute = Client(), Client()
    beats = NOTHING_NEW["heartbeats"](client)
    assert set(stream(client, range(1024), beats)) == {"live"}
    assert set(stream(client, range(1024, 1100), lambda now_ns, number: receive(client, now_ns, number - 128))) == {
        "live"
    }
    assert set(stream(mute, range(1024), NOTHING_NEW["unfit"](mute))[110:]) == {"degraded"}
    assert mute.core.session.dropped["unfit"] == 127, "all but that before the first tick"


def test_a_new_line_has_until_its_first_wave() -> None:
    client = Client()
    stream(client, range(512), lambda now_ns, number: receive(client, now_ns, number))
    client.core.session.state = "resuming"  # as if it had been silent
    client.renew(due_ns(0, 511, DEVICE_HZ))
    beat = Heartbeat(8, Stamp(1))
    states = stream(client, range(512, 1024), lambda now_ns, _: client.core.receive(messages.encode(beat), now_ns))
    assert set(states) == {"live"}
    states = stream(client, range(1024, 1536), lambda now_ns, number: receive(client, now_ns, number - 128, session=8))
    assert set(states) == {"live"}
    states = stream(client, range(1536, 2048), lambda now_ns, _: client.core.receive(messages.encode(beat), now_ns))
    assert states[-1] == "degraded"
