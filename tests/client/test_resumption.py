"""Resumption after a silence of the server: on the same line, or on a new one; the ledger goes on, the force ramps in."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.inputs import Stop
from cogrip.client.safety.limiter import RAMP_IN_S
from cogrip.client.seat.leaving import FADE_S
from cogrip.devices.device import Sample
from cogrip.protocol.settings.sections import Playout
from cogrip.protocol.wire.accounts import LinkCount
from cogrip.protocol.wire.messages import Hello, Waves
from cogrip.protocol.wire.session import QUIET_NS

from tests.client.seated_client import DEVICE_HZ, ROOT, T_N, Client, M, at_ns, walk

QUIET_TICKS = math.ceil(QUIET_NS / 1e9 * DEVICE_HZ)


def silent() -> Client:
    """Live under force, then without a word until it asks for its seat again."""
    client = Client()
    assert client.run(range(400), wave=-0.3)[-1] == pytest.approx(ROOT * 0.3)
    assert client.run(range(400, 420 + QUIET_TICKS))[-1] == 0.0
    assert client.core.session.state == "resuming"
    return client


@pytest.fixture
def client() -> Client:
    return silent()


def goes_on(client: Client) -> None:
    """Let the server go on with its line, unheard, until tick 1000."""
    client.run(range(932, 1000))
    for _ in range(400 // M, 1000 // M):
        client.line.push((-0.3,))


def test_no_force_flows_and_no_wave_goes_out_while_nobody_is_there(client: Client) -> None:
    client.sent()
    assert not any(client.run(range(940, 1500), 0.01)), "though the hand moved"
    assert {type(message) for message in client.sent()} == {Hello}
    assert client.core.safety.state == "degraded"


@pytest.mark.parametrize("renewed", [False, True])
def test_force_ramps_in_from_nothing_once_the_server_is_back(client: Client, renewed: bool) -> None:
    goes_on(client)
    (client.renew if renewed else client.welcome)(at_ns(1000))
    forces = client.run(range(1000, 3000), wave=-0.3)
    assert client.core.session.state == "seated"
    assert client.core.safety.state == "live"
    steps = np.diff(forces)
    inside, border = steps[: 249 * M].reshape(-1, M).T[: M - 1], steps[M - 1 :: M]
    assert abs(inside).max() < ROOT * 0.4 / (RAMP_IN_S * DEVICE_HZ) + 1e-9, "the ramp; a wave is held over a frame"
    assert abs(border).max() < ROOT * 0.4 / (RAMP_IN_S / T_N), "and what is paid back changes no faster"
    assert forces[-1] == pytest.approx(ROOT * 0.3, rel=0.1)
    assert (client.core.session.resumed, client.core.session.renewed) == ((0, 1) if renewed else (1, 0))


def test_the_same_line_goes_on_with_its_frames_and_its_repair(client: Client) -> None:
    goes_on(client)
    client.welcome(at_ns(1000))
    client.run(range(1000, 1100), wave=-0.3)
    count = client.waves.count()
    assert count.sent == count.applied + count.late + count.lost
    assert count.lost > 60
    sent = client.sent()[-1]
    assert isinstance(sent, Waves)
    assert sent.session == 7
    assert sent.first + len(sent.waves) == 1096 // M, "frames follow time"


@pytest.mark.parametrize("at", [1000, 1001, 1003, 1007, 1008])
@pytest.mark.parametrize("acted", [False, True], ids=["between the halves of a tick", "after a tick"])
def test_a_new_line_begins_where_the_hand_is_at_a_frame_border(client: Client, at: int, acted: bool) -> None:
    """Whenever the welcome comes: frame 0 ends at the next border, and holds what the hand does from now on."""
    client.run(range(932, at), 0.02)
    core = client.core
    core.sense(at, Sample((0.02,), (0.0,)), at_ns(at))
    for act in (core.act, client.renew) if acted else (client.renew, core.act):
        client.sent()
        act(at_ns(at))
    client.sent()
    client.run(range(at + 1, 1041), lambda number: 0.02 + 1e-4 * (number - at))
    messages = client.sent()
    assert all(isinstance(message, Waves) and message.session == 8 for message in messages)
    first, last = messages[0], messages[-1]
    assert isinstance(first, Waves)
    assert isinstance(last, Waves)
    assert (first.first, len(first.waves)) == (0, 1)
    border = 1000 if at < 1008 else 1008
    assert first.state == pytest.approx((0.02, 0.02 + 1e-4 * (border + M - at)))
    assert last.first + len(last.waves) == (1040 - border) // M, "numbered from the border"
    moved = sum(last.total) + sum(last.waves)
    assert moved * T_N == pytest.approx(ROOT * 1e-4 * (1040 - at), rel=1e-12), "every tick since, none before"


silences = st.lists(st.integers(1, 100), max_size=4)


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 3), silences, st.integers(0, 3))
def test_the_books_go_on_over_all_lines(seed: int, axes: int, at: list[int], latency: int) -> None:
    """Work is the sum of force times displacement, the leak what of it did not go into one line or another; to the last bit
    that floats allow, for any velocity estimate and any limit of the force."""
    client, random = Client(axes, latency=latency), np.random.default_rng(seed)
    core, work, forces = client.core, 0.0, [(0.0,) * axes] * (latency + 1)
    path, before, ends = walk(seed, 450, axes), None, np.cumsum(at)
    for number, place in enumerate(path):
        if before is not None:
            work += sum(f * (x - old) for f, x, old in zip(forces[-1 - latency], place, before, strict=True))
        if number % M == 0 and number:
            gone = bool(random.random() < 0.3)
            client.hear(at_ns(number), *random.uniform(-0.3, 0.3, axes).tolist(), lost=gone)
        forces.append(client.tick(number, *place.tolist(), velocity=random.uniform(-1, 1, axes).tolist(), age=latency))
        before = place
        if number in ends:
            held = core.ledger.port_j, core.ledger.lost
            core.session.state = "resuming"  # as if it had been silent
            client.renew(at_ns(number))
            assert core.session.state == "seated"
            assert (core.ledger.port_j, core.ledger.lost) == held, "a line that has just begun holds nothing"
    assert core.session.renewed == len(set(ends.tolist()))
    assert core.ledger.work_j == pytest.approx(work, rel=1e-12, abs=1e-15)
    assert core.ledger.leak_j == pytest.approx(core.ledger.work_j - core.ledger.port_j, rel=1e-9, abs=1e-14)
    account = client.account()
    assert account.down.sent == account.down.applied + account.down.late + account.down.lost
    assert account.down.lost == core.ledger.lost
    assert account.down.applied > client.waves.count().applied or core.session.renewed == 0 or ends[0] < 2 * M
    assert account.device_leak_j <= core.ledger.leak_j


def test_the_least_margin_and_all_fates_of_old_lines_are_kept(client: Client) -> None:
    client.waves.down_margin_j = -0.25  # as a broken sender would make it
    before = client.waves.count()
    client.renew(at_ns(932))
    assert client.core.coupling.down_margin_j == -0.25
    client.run(range(932, 1100), wave=-0.1)
    after, account = client.waves.count(), client.account()
    assert account.down_margin_j == -0.25
    names = ("sent", "received", "applied", "lost", "late")
    assert account.down == LinkCount(**{name: getattr(before, name) + getattr(after, name) for name in names})


def test_what_is_sent_in_the_old_session_meanwhile_is_not_for_the_new_line(client: Client) -> None:
    client.renew(at_ns(932))
    client.session -= 1
    client.hear(at_ns(933), -0.9)
    assert client.core.session.dropped == {"other session": 1}
    client.run(range(933, 1000))
    assert client.waves.returning == (0.0,)


# Taking leave ---------------------------------------------------------------------------------------------------------


def test_a_hand_that_stops_releases_the_object_slowly_and_then_leaves() -> None:
    client, number = Client(), 400
    client.run(range(number), wave=-0.3)
    client.core.handle(Stop(), client.core.now_ns)
    client.frames()
    while not client.core.may_leave:
        client.run(range(number, number + 1), wave=-0.3)
        number += 1
    loop = client.waves.loop_frames() or 0.0
    assert number - 400 == pytest.approx(FADE_S * DEVICE_HZ + loop * M, abs=M + 1)
    waves = [wave for (wave,) in client.frames()]
    assert waves[0] == pytest.approx(0.3, rel=0.02), "a hand at rest reflects"
    assert waves[-1] == pytest.approx(-0.15, rel=0.1), "a released end yields by half"
    assert max(abs(np.diff(waves))) < 0.45 / (FADE_S / T_N) * 1.1
    assert client.core.force_n == (0.0,)


def test_what_a_hand_does_once_its_force_fades_does_not_reach_the_object() -> None:
    client, other = Client(), Client()
    for each, speed in ((client, 0.0), (other, 2e-4)):
        each.run(range(400), lambda number: 1e-4 * number, 0.1)
        each.core.handle(Stop(), each.core.now_ns)
        each.run(range(400, 1000), lambda number, speed=speed: 0.04 + speed * (number - 400), 0.1)
    assert client.frames() == other.frames()
    assert client.core.position_m != other.core.position_m


def test_nobody_waits_for_a_line_that_is_not_there(client: Client) -> None:
    client.core.handle(Stop(), client.core.now_ns)
    assert client.core.may_leave


def test_a_server_that_is_started_anew_again_and_again_gets_one_credit(client: Client) -> None:
    """Each line ends in a gap under force: what the credit paid is not there again."""
    left = []
    for back in range(1000, 9000, 1000):
        client.renew(at_ns(back))
        for ticks, wave in ((range(back, back + 200), -0.3), (range(back + 200, back + 1000), None)):
            client.run(ticks, wave=wave)
            left.append(client.core.coupling.credit_left)
    full_w = 1e-3 * Playout().tank_mj / (0.5 * T_N)
    ends = left[1::2]  # within a line a loan may still be repaid
    assert all(later <= earlier + 1e-12 for earlier, later in pairwise(ends))
    assert all(begun <= ended + 1e-9 for begun, ended in zip(left[2::2], ends, strict=False))
    assert left[0] <= full_w
    assert left[-1] < 0.5 * left[0], "it was asked for"
