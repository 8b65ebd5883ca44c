"""Resumption after a silence of the server: on the same line, or on a new one; the ledger goes on, the force ramps in."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.client.inputs import CloseLedger, Stop
from cogrip.client.safety import RAMP_IN_S
from cogrip.client.seated import LEAVE_FADE_S
from cogrip.devices.device import Sample
from cogrip.protocol.accounts import LinkCount, TickCount
from cogrip.protocol.messages import Hello, Waves
from cogrip.protocol.rates import due_ns
from cogrip.protocol.session import QUIET_NS

from tests.client.seated_client import DEVICE_HZ, ROOT, T_N, Client, M, walk

QUIET_TICKS = math.ceil(QUIET_NS / 1e9 * DEVICE_HZ)


def now(number: int) -> int:
    return due_ns(0, number, DEVICE_HZ)


def run(client: Client, ticks: range, wave: float | None, place: float = 0.0) -> list[float]:
    """Tick at a place; a wave a frame, or none. Returns the forces."""
    forces = []
    for number in ticks:
        if number % M == 0 and number and wave is not None:
            client.hear(now(number), wave)
        forces.append(client.tick(number, place)[0])
    return forces


def silent(until: int = 400 + QUIET_TICKS + 20) -> Client:
    """Live under force, then without a word until it asks for its seat again."""
    client = Client()
    assert run(client, range(400), -0.3)[-1] == pytest.approx(ROOT * 0.3)
    assert run(client, range(400, until), None)[-1] == 0.0
    assert client.core.session.state == "resuming"
    return client


@pytest.fixture
def client() -> Client:
    return silent()


def test_no_force_flows_and_no_wave_goes_out_while_nobody_is_there(client: Client) -> None:
    client.sent()
    forces = run(client, range(940, 1500), None, place=0.01)
    assert forces == [0.0] * len(forces), "though the hand moved"
    assert {type(message) for message in client.sent()} == {Hello}
    assert client.core.safety.state == "degraded"


@pytest.mark.parametrize("renewed", [False, True])
def test_force_ramps_in_from_nothing_once_the_server_is_back(client: Client, renewed: bool) -> None:
    back = 1000
    run(client, range(932, back), None)
    for _ in range(400 // M, back // M):
        client.line.push((-0.3,))  # a server that is there goes on
    (client.renew if renewed else client.welcome)(now(back))
    forces = run(client, range(back, back + 2000), -0.3)
    assert client.core.session.state == "seated"
    assert client.core.safety.state == "live"
    inside, border = np.diff(forces).reshape(-1)[: 249 * M].reshape(-1, M).T[: M - 1], np.diff(forces)[M - 1 :: M]
    assert abs(inside).max() < ROOT * 0.4 / (RAMP_IN_S * DEVICE_HZ) + 1e-9, "the ramp; a wave is held over a frame"
    assert abs(border).max() < ROOT * 0.4 / (RAMP_IN_S / T_N), "and what is paid back changes no faster"
    assert forces[-1] == pytest.approx(ROOT * 0.3, rel=0.1)
    assert (client.core.session.resumed, client.core.session.renewed) == ((0, 1) if renewed else (1, 0))


def test_the_same_line_goes_on_with_its_frames_and_its_repair(client: Client) -> None:
    for _ in range(400 // M, 1000 // M):
        client.line.push((-0.3,))  # the server went on
    run(client, range(932, 1000), None)
    client.welcome(now(1000))
    run(client, range(1000, 1100), -0.3)
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
    run(client, range(932, at), None, place=0.02)
    client.sent()
    core = client.core
    if acted:
        client.tick(at, 0.02)
        client.renew(now(at))
    else:
        core.sense(at, Sample((0.02,), (0.0,)), now(at))
        client.renew(now(at))
        core.act(now(at))
    client.sent()
    after = at + 1
    for number in range(after, 1041):
        client.tick(number, 0.02 + 1e-4 * (number - at))
    messages = client.sent()
    assert all(isinstance(message, Waves) and message.session == 8 for message in messages)
    first, last = messages[0], messages[-1]
    assert isinstance(first, Waves)
    assert isinstance(last, Waves)
    assert (first.first, len(first.waves)) == (0, 1)
    assert first.state == pytest.approx((0.02, 0.02 + 1e-4 * (1008 - at if at < 1008 else 1016 - at)))
    assert last.first + len(last.waves) == (1040 - (1000 if at < 1008 else 1008)) // M, "numbered from the border"
    moved = sum(total for total in last.total) + sum(last.waves)
    assert moved * T_N == pytest.approx(ROOT * 1e-4 * (1040 - at), rel=1e-12), "every tick since, none before"


@settings(max_examples=40)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 3),
    st.lists(st.integers(1, 100), min_size=1, max_size=4),
    st.integers(0, 3),
)
def test_the_books_go_on_over_all_lines(seed: int, axes: int, at: list[int], latency: int) -> None:
    """Work is the sum of force times displacement, the leak what of it did not go into one line or another; to the last bit
    that floats allow."""
    client, random = Client(axes, latency=latency), np.random.default_rng(seed)
    core, number, work, forces = client.core, 0, 0.0, [(0.0,) * axes] * (latency + 1)
    path, before, port_j, ends = walk(seed, 450, axes), None, 0.0, np.cumsum(at)
    lost = 0
    for number, place in enumerate(path):
        if before is not None:
            work += sum(f * (x - old) for f, x, old in zip(forces[-1 - latency], place, before, strict=True))
        if number % M == 0 and number:
            gone = bool(random.random() < 0.3)
            client.hear(now(number), *random.uniform(-0.3, 0.3, axes).tolist(), lost=gone)
        forces.append(client.tick(number, *place.tolist(), velocity=random.uniform(-1, 1, axes).tolist(), age=latency))
        before = place
        if number in ends:
            port_j, lost = core.ledger.port_j, core.ledger.lost
            core.session.state = "resuming"  # as if it had been silent
            client.renew(now(number))
            assert core.session.state == "seated"
            assert core.ledger.port_j == port_j, "a line that has just begun holds nothing"
            assert core.ledger.lost == lost
    assert core.session.renewed == len(set(ends.tolist()))
    assert core.ledger.work_j == pytest.approx(work, rel=1e-9, abs=1e-12)
    assert core.ledger.leak_j == pytest.approx(core.ledger.work_j - core.ledger.port_j, rel=1e-9, abs=1e-12)
    account = core.handle(CloseLedger(TickCount()), core.now_ns)
    assert account.down.sent == account.down.applied + account.down.late + account.down.lost
    assert account.down.lost == core.ledger.lost
    assert account.down.applied > client.waves.count().applied or core.session.renewed == 0 or ends[0] < 2 * M
    assert account.device_leak_j <= core.ledger.leak_j


def test_the_least_margin_and_all_fates_of_old_lines_are_kept(client: Client) -> None:
    core = client.core
    client.waves.down_margin_j = -0.25  # as a broken sender would make it
    before = client.waves.count()
    client.renew(now(932))
    assert core.coupling.down_margin_j == -0.25
    run(client, range(932, 1100), -0.1)
    after = client.waves.count()
    account = core.handle(CloseLedger(TickCount()), core.now_ns)
    assert account.down_margin_j == -0.25
    assert account.down == LinkCount(
        **{
            name: getattr(before, name) + getattr(after, name)
            for name in ("sent", "received", "applied", "lost", "late")
        }
    )


def test_what_is_sent_in_the_old_session_meanwhile_is_not_for_the_new_line(client: Client) -> None:
    client.renew(now(932))
    client.session -= 1
    client.hear(now(933), -0.9)
    assert client.core.session.dropped == {"other session": 1}
    run(client, range(933, 1000), None)
    assert client.waves.returning == (0.0,)


# Taking leave ---------------------------------------------------------------------------------------------------------


def test_a_hand_that_stops_releases_the_object_slowly_and_then_leaves() -> None:
    client = Client()
    run(client, range(400), -0.3)
    client.core.handle(Stop(), client.core.now_ns)
    client.frames()
    ticks = 0
    while not client.core.may_leave:
        number = 400 + ticks
        if number % M == 0:
            client.hear(now(number), -0.3)
        client.tick(number, 0.0)
        ticks += 1
    loop = client.waves.loop_frames() or 0.0
    assert ticks == pytest.approx(LEAVE_FADE_S * DEVICE_HZ + loop * M, abs=M + 1)
    waves = [wave for (wave,) in client.frames()]
    assert waves[0] == pytest.approx(0.3, rel=0.02), "a hand at rest reflects"
    assert waves[-1] == pytest.approx(-0.15, rel=0.1), "a released end yields by half"
    assert max(abs(np.diff(waves))) < 0.45 / (LEAVE_FADE_S / T_N) * 1.1
    assert client.core.force_n == (0.0,)


def test_what_a_hand_does_once_its_force_fades_does_not_reach_the_object() -> None:
    client, other = Client(), Client()
    for each, speed in ((client, 0.0), (other, 2e-4)):
        for number in range(1000):
            if number == 400:
                each.core.handle(Stop(), each.core.now_ns)
            if number % M == 0 and number:
                each.hear(now(number), 0.1)
            place = 1e-4 * min(number, 400) + speed * max(0, number - 400)
            each.tick(number, place)
    assert client.frames() == other.frames()
    assert client.core.position_m != other.core.position_m


def test_nobody_waits_for_a_line_that_is_not_there(client: Client) -> None:
    client.core.handle(Stop(), client.core.now_ns)
    assert client.core.may_leave


def test_a_server_that_is_started_anew_again_and_again_gets_one_credit() -> None:
    """Each line ends in a gap under force: what the credit paid is not there again."""
    client, left = silent(), []
    for number in range(8):
        back = 1000 + number * 1000
        client.renew(now(back))
        run(client, range(back, back + 200), -0.3)
        left.append(client.core.coupling.credit_left)
        run(client, range(back + 200, back + 1000), None)
        left.append(client.core.coupling.credit_left)
    full_w = 1e-3 / (0.5 * T_N)
    assert all(later <= earlier + 1e-12 for earlier, later in zip(left[::2], left[1::2], strict=True))
    assert left[0] <= full_w
    assert left[-1] < 0.5 * left[0], "it was asked for"
