"""The client core: exact energy ledger, no drift, skipped ticks, a stale link."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.felt_stiffness import REST_S, FeltStiffness
from cogrip.client.inputs import DeviceOpened, Rearm
from cogrip.client.seat.hand_motion import RECKON_S
from cogrip.protocol.line.concealment import ELASTIC_LIMIT
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Farewell, Power, Stamp, State, Waves
from cogrip.protocol.wire.session import STALE_NS

from tests.client.seated_client import DEVICE_HZ, ROOT, T_C, T_N, Client, M, at_ns, capability, walk


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_the_displacement_encoder_cannot_drift(seed: int, axes: int) -> None:
    """sum u T_c = sqrt(2b) (x - x_0) - sum v T_c, tick by tick, with any velocity reading."""
    client, random = Client(axes), np.random.default_rng(seed)
    path = walk(seed, 300, axes)
    forward, returning = np.zeros(axes), np.zeros(axes)
    held = client.waves.returning
    for number, place in enumerate(path):
        if number % M == 0 and number:
            client.hear(at_ns(number), *random.uniform(-0.3, 0.3, axes).tolist())
        client.tick(number, *place.tolist(), velocity=random.uniform(-9.0, 9.0, axes).tolist())
        if number:
            forward += np.array(client.waves.forward) * T_C
            returning += np.array(held) * T_C
        held = client.waves.returning
        assert np.abs(forward - (ROOT * (place - path[0]) - returning)).max() <= 1e-12


def test_the_velocity_encoder_drifts_with_its_reading() -> None:
    """The other encoder, for comparison: a reading that is off by 1 mm/s walks the proxy away at 1 mm/s."""
    for encoder, drift in (("displacement", 0.0), ("velocity", pytest.approx(1e-3, rel=0.01))):
        client = Client(encoder=encoder)
        client.run(range(1025), wave=0.0, speed_mps=1e-3)
        assert sum(wave for (wave,) in client.frames()) * T_N / ROOT == drift


@given(st.lists(st.integers(1, 40), min_size=5, max_size=60), st.integers(0, 2**32 - 1))
def test_skipped_ticks_are_entered_and_frames_numbered_on(gaps: list[int], seed: int) -> None:
    """Every border has its frame, and the frames hold the whole displacement, for any gaps of the loop."""
    client, random = Client(), np.random.default_rng(seed)
    number, x, work = 0, 0.02, 0.0
    (force,) = client.tick(0, x)
    held = [0.0]  # the returning wave of each frame
    for gap in [M, *gaps]:  # the first frame alone: it sets the playout
        before, number = number, number + gap
        for _ in range(number // M - before // M):
            held.append(float(random.uniform(-0.2, 0.2)))
            client.hear(at_ns(number), held[-1])
        step = float(random.uniform(-1e-4, 1e-4)) * gap
        work += force * step
        x += step
        (force,) = client.tick(number, x, velocity=[float(random.uniform(-1.0, 1.0))])
        sent = client.sent()
        assert len(sent) == (1 if number // M > before // M else 0)
        for message in sent:
            assert isinstance(message, Waves)
            assert message.first + len(message.waves) == number // M
    assert client.core.ledger.work_j == pytest.approx(work, rel=1e-12, abs=1e-15)
    assert client.waves.count().applied == number // M
    returned = sum(held[(tick - 1) // M] for tick in range(1, number + 1))
    assert client.total() == pytest.approx(ROOT * (x - 0.02) - returned * T_C, abs=1e-12)


def test_displacement_over_missing_samples_is_reckoned_and_then_corrected() -> None:
    """The hand goes on as it did for a few ticks; the sum of what was sent is the true displacement all the same."""
    client = Client()
    client.run(range(20), lambda number: 0.001 * number, speed_mps=1.0)
    core = client.core
    for number in range(20, 30):
        core.sense(number, None, at_ns(number))
        core.act(at_ns(number))
        assert core.position_m[0] == pytest.approx(0.019 + min((number - 19) * T_C, RECKON_S))
    assert core.safety.state == "live"
    client.tick(30, 0.02)
    assert core.position_m == (0.02,)
    assert client.total() == pytest.approx(ROOT * 0.02, abs=1e-12)


def test_a_stalled_device_faults_and_its_line_ends_in_a_matched_termination() -> None:
    client = Client()
    client.run(range(200))
    core = client.core
    for number in range(200, 260):
        if number % M == 0:
            client.hear(at_ns(number), 0.5)
        core.sense(number, None, at_ns(number))
        core.act(at_ns(number))
    assert core.safety.state == "fault"
    assert client.waves.returning == (0.5,)
    assert client.waves.forward == (0.0,), "what comes is absorbed"
    assert core.safety.quiet
    client.tick(260, 0.0)
    assert core.safety.state == "fault"
    core.handle(Rearm(), core.now_ns)
    assert core.safety.state == "armed"
    client.tick(261, 0.0)
    assert core.safety.state == "live"


def test_a_stale_link_takes_the_force_away_and_gives_it_back() -> None:
    client, force = Client(), []
    silent = range(512, 512 + 256)
    for number in range(1536):
        if number % M == 0:
            client.hear(at_ns(number), -0.3, lost=number in silent)
        force.append(client.tick(number, 0.0)[0])
        if number in silent:
            assert (client.core.safety.state == "degraded") is (at_ns(number) - at_ns(504) > STALE_NS)
    assert force[511] == pytest.approx(ROOT * 0.3, rel=0.05), "but for what is compensated of the first frame"
    assert force[silent[-1]] == 0.0
    assert client.core.safety.state == "live"
    assert ROOT * 0.3 * (1.0 - 1e-5) < force[-1] <= ROOT * (0.3 + ELASTIC_LIMIT), "what was lost is compensated by now"
    assert client.core.safety.reason == ""
    assert max(abs(np.diff(force[768:]))) < ROOT * 0.3 / (0.3 * DEVICE_HZ / M), "it ramps in, it does not jump"


def test_the_force_law() -> None:
    """F = b xdot - sqrt(2b) v (P eq. 16)."""
    client = Client(axes=2)
    for number in range(12_000):
        if number % M == 0:
            client.hear(at_ns(number), 0.2, -0.1)
        force = client.tick(number, 0.0, 0.0, velocity=[0.03, -0.02])
    assert force == pytest.approx((20 * 0.03 - ROOT * 0.2, 20 * -0.02 + ROOT * 0.1))


def test_virtual_coupling_sends_states_and_holds_its_object() -> None:
    client = Client(kind="coupling")

    def say(number: int) -> None:
        state = State(7, number // M, (0.004,), (0.02,), 0.0, 0, Stamp(1 + number))
        client.core.receive(messages.encode(state), at_ns(number))

    say(0)
    assert client.run(range(400), 0.01, say, 0.05)[-1] == pytest.approx(1000.0 * 0.006 + 10.0 * 0.03)
    sent = client.sent()
    assert [message.number for message in sent if isinstance(message, State)] == list(range(len(sent)))


STATE = State(7, 0, (0.0,), (0.0,), 0.0, 0, Stamp(1))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("wave", Waves(7, 0, (0.1, 0.1), (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0, Stamp(1), (0.0,) * 4)),
        ("wave", STATE),
        ("coupling", Power(7, 0, *[(0.0,)] * 5, 0.0, 0, Stamp(1))),
        ("tdpa", STATE),
        ("tdpa", Power(7, 0, *[(0.0, 0.0)] * 5, 0.0, 0, Stamp(1))),
        ("tdpa", Power(7, 0, (0.0,), (0.0,), (0.0, 0.0), (0.0,), (0.0,), 0.0, 0, Stamp(1))),
        ("coupling", State(7, 0, (0.0,), (0.0, 0.0), 0.0, 0, Stamp(1))),
    ],
)
def test_a_message_that_does_not_fit_the_seat_is_counted(kind: str, message: messages.AnyMessage) -> None:
    client = Client(kind=kind)
    client.tick(0, 0.0)
    client.core.receive(messages.encode(message), 0)
    assert client.core.session.dropped == {"unfit": 1}


@pytest.mark.parametrize("network_hz", [32, 128, 1024])
def test_felt_stiffness_needs_a_hand_at_rest_that_presses(network_hz: int) -> None:
    """The time is the same at every rate."""
    frame_s = 1.0 / network_hz
    samples = round(REST_S * network_hz)
    rest = FeltStiffness(0.0, frame_s)
    for _ in range(samples - 1):
        rest.add(2e-3, 1.5)
    assert rest.stiffness_npm() is None
    rest.add(2e-3, 1.5)
    assert rest.stiffness_npm() == pytest.approx(750.0)
    rest.add(2.1e-3, 1.5)
    assert rest.stiffness_npm() == pytest.approx(750.0, rel=0.01), "it stayed within a tenth"
    rest.add(2.3e-3, 1.5)
    assert rest.stiffness_npm() is None, "it moved"
    for depth, force in ((-1e-3, 1.0), (1e-3, 0.0), (1e-18, 1e-15)):
        rest = FeltStiffness(0.0, frame_s)
        for _ in range(samples):
            rest.add(depth, force)
        assert rest.stiffness_npm() is None


def test_a_hand_at_rest_is_judged_by_the_counts_of_the_device_that_is_open() -> None:
    """A device may say only once it is open how coarse its counts are: a hand that dithers by one count is at rest."""
    client = Client(thing="wall")
    client.core.handle(DeviceOpened(replace(capability(), resolution_m=5e-4)), client.core.now_ns)
    client.run(range(1024), lambda number: 0.010 + 5e-4 * (number // M % 2), -0.3)
    assert client.account().felt_stiffness_npm == pytest.approx(ROOT * 0.3 / 0.01025, rel=0.05)


def test_a_kicked_client_says_why_in_its_account() -> None:
    """The account goes into the summary of its run (`reason`)."""
    client = Client()
    client.tick(0, 0.0)
    farewell = Farewell(client.session, "kicked by the administrator: too rough", None, None)
    client.core.receive(messages.encode(farewell), 0)
    assert client.account().reason == "the server said goodbye: kicked by the administrator: too rough"
