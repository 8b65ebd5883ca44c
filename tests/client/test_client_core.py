"""One person's client without I/O: exact books, no drift, skipped ticks, a stale link."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.core import RECKON_TICKS, ClientCore
from cogrip.client.rest import SAMPLES, RestStiffness
from cogrip.client.velocity import AlphaBeta
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.devices.device import Capability, Sample
from cogrip.devices.simulated.ideal import IdealPlant, IdealSettings
from cogrip.protocol import messages
from cogrip.protocol.line import REPAY_LIMIT, LineSender
from cogrip.protocol.messages import PROTOCOL_VERSION, Stamp, State, Waves, Welcome
from cogrip.protocol.rates import due_ns
from cogrip.protocol.session import STALE_NS, make_hello
from cogrip.protocol.settings import digest, resolve, seat_settings
from cogrip.sim.laboratory import Laboratory

DEVICE_HZ, M = 1024, 8
T_C, T_N = 1 / DEVICE_HZ, 1 / 128
ROOT = math.sqrt(2.0 * 20.0)


def capability(axes: int = 1, gives_velocity: bool = True) -> Capability:
    return Capability(
        family="test", model="arm", axes=axes, workspace_m=((-1.0, 1.0),) * axes, peak_force_n=100.0,
        continuous_force_n=2.0, stiffness_npm=1e3, damping_nspm=10.0, slew_nps=math.inf, speed_mps=math.inf,
        resolution_m=0.0, apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=gives_velocity,
    )  # fmt: skip


class Client:
    """A seated core with a server of our own: what it sends is read back, waves are handed to it frame by frame."""

    def __init__(self, axes: int = 1, gives_velocity: bool = True, **coupling: object) -> None:
        settings = resolve({"object": {"axes": axes}, "coupling": coupling, "users": [{"name": "anna"}]})
        hello = make_hello(
            software="test", nonce=1, room="", name="", digest="", device="test", axes=axes, rate_hz=1024.0
        )  # fmt: skip
        self.core = ClientCore(hello, capability(axes, gives_velocity))
        self.core.call(0)
        welcome = Welcome(PROTOCOL_VERSION, 1, 7, digest(settings), "test", seat_settings(settings, 0))
        self.core.receive(messages.encode(welcome), 0)
        assert self.core.seated
        self.core.outbox.clear()
        self.line = LineSender(axes, 8)
        self.axes = axes

    @property
    def waves(self) -> WaveCoupling:
        assert isinstance(self.core.coupling, WaveCoupling)
        return self.core.coupling

    def hear(self, now_ns: int, *wave: float, lost: bool = False) -> None:
        """A datagram with the server's next wave."""
        self.line.push(wave or (0.0,) * self.axes)
        if lost:
            return
        first, waves, total, squares = self.line.contents()
        state = (0.0,) * (2 * self.axes)
        message = Waves(7, first, waves, total, squares, 0.0, 0.0, 0, Stamp(now_ns + 1), state)
        self.core.receive(messages.encode(message), now_ns)

    def tick(self, number: int, *position_m: float, velocity: Sequence[float] = ()) -> tuple[float, ...]:
        now_ns = due_ns(0, number, DEVICE_HZ)
        speed = tuple(velocity) or (0.0,) * self.axes
        self.core.sense(number, Sample(position_m, speed), now_ns)
        return self.core.act(now_ns)

    def sent(self) -> list[messages.AnyMessage]:
        found = [messages.decode(datagram) for datagram in self.core.outbox]
        self.core.outbox.clear()
        return found

    def frames(self) -> list[tuple[float, ...]]:
        """All frames sent since the last call, each once, in order."""
        found: dict[int, tuple[float, ...]] = {}
        for message in self.sent():
            assert isinstance(message, Waves)
            for at in range(len(message.waves) // self.axes):
                found[message.first + at] = message.waves[at * self.axes : (at + 1) * self.axes]
        assert sorted(found) == list(range(min(found), max(found) + 1))
        return [found[number] for number in sorted(found)]


def walk(seed: int, steps: int, axes: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    random = np.random.default_rng(seed)
    return np.cumsum(random.uniform(-1e-4, 1e-4, (steps, axes)), axis=0)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_work_is_the_sum_of_force_times_displacement(seed: int, axes: int) -> None:
    """Whatever the velocity estimate says, and whatever safety takes of the force."""
    client, random = Client(axes), np.random.default_rng(seed)
    path, work, before = walk(seed, 400, axes), 0.0, None
    force: tuple[float, ...] = (0.0,) * axes
    for number, place in enumerate(path):
        if before is not None:
            work += sum(f * (x - old) for f, x, old in zip(force, place, before, strict=True))
        if number % M == 0 and number:
            client.hear(due_ns(0, number, DEVICE_HZ), *random.uniform(-0.3, 0.3, axes).tolist())
        force = client.tick(number, *place.tolist(), velocity=random.uniform(-1.0, 1.0, axes).tolist())
        before = place
    core = client.core
    assert core.work_j == pytest.approx(work, rel=1e-12, abs=1e-15)
    assert core.leak_j == pytest.approx(work - client.waves.port_j, rel=1e-9, abs=1e-14)


def test_the_leak_is_the_dampers_error_and_nothing_else() -> None:
    """leak = sum b (y_est - y) y T_c once the force is let through whole (theory section 3.6)."""
    client, leak, start = Client(), 0.0, 0.0
    random, x, estimate = np.random.default_rng(4), 0.0, 0.0
    for number in range(1000):
        if number == 400:  # the ramp is behind us
            start = client.core.leak_j
            leak = 0.0
        step = float(random.uniform(-1e-4, 1e-4))
        if number:
            leak += 20.0 * (estimate - step / T_C) * step
            x += step
        estimate = float(random.uniform(-0.1, 0.1))
        if number % M == 0 and number:
            client.hear(due_ns(0, number, DEVICE_HZ), float(random.uniform(-0.2, 0.2)))
        client.tick(number, x, velocity=[estimate])
    assert client.core.leak_j - start == pytest.approx(leak, rel=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(1, 3))
def test_the_displacement_encoder_cannot_drift(seed: int, axes: int) -> None:
    """sum u T_c = sqrt(2b) (x - x_0) - sum v T_c, tick by tick, with any velocity reading."""
    client, random = Client(axes), np.random.default_rng(seed)
    path = walk(seed, 300, axes)
    forward, returning = np.zeros(axes), np.zeros(axes)
    held = client.waves.returning
    for number, place in enumerate(path):
        if number % M == 0 and number:
            client.hear(due_ns(0, number, DEVICE_HZ), *random.uniform(-0.3, 0.3, axes).tolist())
        client.tick(number, *place.tolist(), velocity=random.uniform(-9.0, 9.0, axes).tolist())
        if number:
            forward += np.array(client.waves.forward) * T_C
            returning += np.array(held) * T_C
        held = client.waves.returning
        assert forward == pytest.approx(ROOT * (place - path[0]) - returning, abs=1e-12)


def test_the_velocity_encoder_drifts_with_its_reading() -> None:
    """The other encoder, for comparison: a reading that is off by 1 mm/s walks the proxy away at 1 mm/s."""
    drift = {}
    for encoder in ("displacement", "velocity"):
        client = Client(encoder=encoder)
        for number in range(1025):
            client.tick(number, 0.0, velocity=[1e-3])
        drift[encoder] = sum(wave for (wave,) in client.frames()) * T_N / ROOT
    assert drift["displacement"] == 0.0
    assert drift["velocity"] == pytest.approx(1e-3, rel=0.01)


@given(st.lists(st.integers(1, 40), min_size=5, max_size=60), st.integers(0, 2**32 - 1))
def test_skipped_ticks_are_booked_and_frames_numbered_on(gaps: list[int], seed: int) -> None:
    """However the loop stumbles: every border has its frame, and the frames hold the whole displacement."""
    client, random = Client(), np.random.default_rng(seed)
    number, x, work = 0, 0.02, 0.0
    (force,) = client.tick(0, x)
    held = [0.0]  # the returning wave of each frame
    for gap in [M, *gaps]:  # the first frame alone: it sets the playout
        before, number = number, number + gap
        for _ in range(number // M - before // M):
            held.append(float(random.uniform(-0.2, 0.2)))
            client.hear(due_ns(0, number, DEVICE_HZ), held[-1])
        step = float(random.uniform(-1e-4, 1e-4)) * gap
        work += force * step
        x += step
        (force,) = client.tick(number, x, velocity=[float(random.uniform(-1.0, 1.0))])
        sent = client.sent()
        assert len(sent) == (1 if number % M == 0 or gap >= M else 0)
        for message in sent:
            assert isinstance(message, Waves)
            assert message.first + len(message.waves) == number // M
    assert client.core.work_j == pytest.approx(work, rel=1e-12, abs=1e-15)
    assert client.waves.count().applied == number // M
    sender = client.waves._sender
    frames = sum(sender._total) + sum(wave for (wave,) in sender._recent)
    unsent = sum(client.waves._decimator._sum)  # type: ignore[attr-defined]
    returned = sum(held[(tick - 1) // M] for tick in range(1, number + 1))
    assert frames * T_N + unsent * T_C == pytest.approx(ROOT * (x - 0.02) - returned * T_C, abs=1e-12)


def test_frames_inside_a_gap_play_their_own_waves() -> None:
    """Three frames come while the loop is away: each is held over its own ticks, none is lost or played twice."""
    client = Client()
    client.tick(0, 0.0)
    client.hear(0, 0.1)
    for number in range(1, 9):
        client.tick(number, 0.0)
    assert client.waves.returning == (0.1,)
    for wave in (0.2, 0.3, 0.4):
        client.hear(due_ns(0, 9, DEVICE_HZ), wave)
    client.tick(32, 0.0)
    assert client.waves.returning == (0.4,)
    assert client.waves.count().applied == 4
    energy = sum(wave**2 for wave in (0.1, 0.2, 0.3)) * T_N / 2
    assert client.waves.used_j == pytest.approx(energy, rel=1e-12)
    assert client.frames() == [pytest.approx((-wave,)) for wave in (0.0, 0.1, 0.2, 0.3)], "a hand at rest reflects"


def test_displacement_over_missing_samples_is_reckoned_and_then_put_right() -> None:
    """For a few ticks the hand goes on as it did; whatever was assumed, the sum of what was sent is the true displacement."""
    client = Client()
    for number in range(20):
        client.tick(number, 0.001 * number, velocity=[1.0])
    core = client.core
    for number in range(20, 30):
        core.sense(number, None, due_ns(0, number, DEVICE_HZ))
        core.act(due_ns(0, number, DEVICE_HZ))
        assert core.position_m[0] == pytest.approx(0.019 + min(number - 19, RECKON_TICKS) * T_C)
    assert core.safety.state == "live"
    client.tick(30, 0.02)
    assert core.position_m == (0.02,)
    total = sum(wave for (wave,) in client.frames()) * T_N + sum(client.waves._decimator._sum) * T_C  # type: ignore[attr-defined]
    assert total == pytest.approx(ROOT * 0.02, abs=1e-12)


def test_a_stalled_device_faults_and_its_line_ends_in_a_matched_termination() -> None:
    client = Client()
    for number in range(200):
        client.tick(number, 0.0)
    core = client.core
    for number in range(200, 260):
        now_ns = due_ns(0, number, DEVICE_HZ)
        if number % M == 0:
            client.hear(now_ns, 0.5)
        core.sense(number, None, now_ns)
        core.act(now_ns)
    assert core.safety.state == "fault"
    assert client.waves.returning == (0.5,)
    assert client.waves.forward == (0.0,), "what comes is absorbed"
    assert core.safety.quiet
    client.tick(260, 0.0)
    assert core.safety.state == "fault"
    core.rearm()
    assert core.safety.state == "live"


def test_a_stale_link_takes_the_force_away_and_gives_it_back() -> None:
    client, force = Client(), []
    silent = range(512, 512 + 256)
    for number in range(1536):
        now_ns = due_ns(0, number, DEVICE_HZ)
        if number % M == 0:
            client.hear(now_ns, -0.3, lost=number in silent)
        force.append(client.tick(number, 0.0)[0])
        last_ns = due_ns(0, 504, DEVICE_HZ)
        if number in silent:
            assert (client.core.safety.state == "degraded") is (now_ns - last_ns > STALE_NS)
    assert force[511] == pytest.approx(ROOT * 0.3)
    assert force[silent[-1]] == 0.0
    assert client.core.safety.state == "live"
    assert force[-1] == pytest.approx(ROOT * (0.3 + REPAY_LIMIT)), "what was lost is still being paid back"
    assert client.core.safety.reason == ""
    assert max(abs(np.diff(force[768:]))) < ROOT * 0.3 / (0.3 * DEVICE_HZ) * 1.5, "it ramps in, it does not jump"


def test_the_force_law() -> None:
    """F = b xdot - sqrt(2b) v (P eq. 16)."""
    client = Client(axes=2)
    force = client.tick(0, 0.0, 0.0)
    client.hear(0, 0.2, -0.1)
    for number in range(1, 500):
        if number % M == 0:
            client.hear(due_ns(0, number, DEVICE_HZ), 0.2, -0.1)
        force = client.tick(number, 0.0, 0.0, velocity=[0.03, -0.02])
    assert force == pytest.approx((20 * 0.03 - ROOT * 0.2, 20 * -0.02 + ROOT * 0.1))


def test_virtual_coupling_sends_states_and_holds_its_object() -> None:
    client = Client(kind="coupling")
    force = client.tick(0, 0.01)
    client.core.receive(messages.encode(State(7, 0, (0.004,), (0.02,), 0.0, 0, Stamp(1))), 0)
    for number in range(1, 400):
        if number % M == 0:
            state = State(7, number // M, (0.004,), (0.02,), 0.0, 0, Stamp(1 + number))
            client.core.receive(messages.encode(state), due_ns(0, number, DEVICE_HZ))
        force = client.tick(number, 0.01, velocity=[0.05])
    assert force == pytest.approx((1000.0 * 0.006 + 10.0 * 0.03,))
    sent = client.sent()
    assert [message.number for message in sent if isinstance(message, State)] == list(range(len(sent)))


@pytest.mark.parametrize(
    "message",
    [
        State(7, 0, (0.0,), (0.0,), 0.0, 0, Stamp(1)),
        Waves(7, 0, (0.1, 0.1), (0.0, 0.0), (0.0, 0.0), 0.0, 0.0, 0, Stamp(1), (0.0,) * 4),
    ],
    ids=["kind", "axes"],
)
def test_what_does_not_fit_the_seat_is_counted(message: messages.AnyMessage) -> None:
    client = Client()
    client.tick(0, 0.0)
    client.core.receive(messages.encode(message), 0)
    assert client.core.session.dropped == {"unfit": 1}


# Velocity from encoder counts ----------------------------------------------------------------------------------------

Q = 0.055e-3  # one count of the encoder [m]
ALPHA, BETA = 1.0 - 0.6**2, (1.0 - 0.6) ** 2


def test_one_encoder_count_moves_the_estimate_by_9_mm_per_second() -> None:
    """beta q / T = 0.16 x 0.055 mm x 1024 Hz, 0.18 N at b = 20; the plain difference would jump by 56 mm/s, 1.1 N."""
    estimator = AlphaBeta(1, T_C)
    estimator.update((0.0,))
    assert estimator.update((Q,))[0] == pytest.approx(BETA * Q / T_C, rel=1e-12)
    assert pytest.approx(9.0e-3, rel=0.01) == BETA * Q / T_C
    assert pytest.approx(0.056, rel=0.01) == Q / T_C


def test_noise_of_the_estimate_is_what_the_filter_promises() -> None:
    """var = 2 beta^2 / (alpha (4 - 2 alpha - beta)) of the noise's over T^2, for white noise of a count's width."""
    random, estimator = np.random.default_rng(1), AlphaBeta(1, T_C)
    noise = random.uniform(-Q / 2, Q / 2, 200_000)
    found = np.array([estimator.update((value,))[0] for value in noise.tolist()])[1000:]
    expected = Q / math.sqrt(12) / T_C * math.sqrt(2 * BETA**2 / (ALPHA * (4 - 2 * ALPHA - BETA)))
    assert found.std() == pytest.approx(expected, rel=0.03)
    assert expected == pytest.approx(2.9e-3, rel=0.01), "2.9 mm/s: 0.06 N at b = 20"


def test_a_steady_speed_is_found_exactly_and_with_skipped_ticks_too() -> None:
    estimator, tick = AlphaBeta(2, T_C), 0
    velocity: list[float] = []
    random = np.random.default_rng(2)
    for _ in range(300):
        gap = int(random.integers(1, 5))
        tick += gap
        velocity = list(estimator.update((0.2 * tick * T_C, -0.1 * tick * T_C), gap))
    assert velocity == pytest.approx([0.2, -0.1], rel=1e-9)


def test_an_accelerating_hand_is_followed_three_and_a_half_ticks_late() -> None:
    """Lag = (alpha / beta - 1/2) T_c = 3.4 ms."""
    estimator, velocity = AlphaBeta(1, T_C), 0.0
    for tick in range(500):
        (velocity,) = estimator.update((0.5 * 3.0 * (tick * T_C) ** 2,))
    lag_s = 499 * T_C - velocity / 3.0
    assert lag_s == pytest.approx(3.5 * T_C, rel=1e-6)


@pytest.mark.parametrize(
    ("memory", "mass_kg", "holds"), [(0.6, 0.020, False), (0.6, 0.022, True), (0.8, 0.043, False), (0.8, 0.048, True)]
)
def test_a_damper_that_lags_too_much_shakes_the_arm(memory: float, mass_kg: float, holds: bool) -> None:
    """F = b y_est on a bare arm, b = 20: it holds from 20.8 g with memory 0.6, from 44.5 g with 0.8."""
    plant, estimator = IdealPlant(IdealSettings(mass_kg=mass_kg), 1), AlphaBeta(1, T_C, memory)
    plant.open(DEVICE_HZ, 0.0, 0.0, (0.0,))
    plant.velocity_mps = [0.1]
    for _ in range(4096):
        (speed,) = estimator.update(plant.position_m)
        plant.step((0.0,), (20.0 * speed,))
    assert (abs(plant.velocity_mps[0]) < 1e-6) is holds
    assert holds or abs(plant.velocity_mps[0]) > 1.0


# Stiffness felt at rest ----------------------------------------------------------------------------------------------


def test_rest_stiffness_needs_a_hand_at_rest_that_presses() -> None:
    rest = RestStiffness(0.0)
    for _ in range(SAMPLES - 1):
        rest.add(2e-3, 1.5)
    assert rest.stiffness_npm() is None
    rest.add(2e-3, 1.5)
    assert rest.stiffness_npm() == pytest.approx(750.0)
    rest.add(2.1e-3, 1.5)
    assert rest.stiffness_npm() is None, "it moved"
    for depth, force in ((-1e-3, 1.0), (1e-3, 0.0)):
        rest = RestStiffness(0.0)
        for _ in range(SAMPLES):
            rest.add(depth, force)
        assert rest.stiffness_npm() is None


# In a session ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("device", ["sim:ideal", "sim:phantom"])
def test_books_of_a_whole_session(device: str) -> None:
    """Work from the trace of forces and positions, port energy from the waves, the rest is the leak."""
    settings = resolve({"seconds": 2.0, "users": [{"name": "a", "device": device}, {"name": "b", "device": device}]})
    lab = Laboratory(settings)
    trace: list[list[tuple[float, float]]] = [[], []]

    def watch(_: Laboratory) -> None:
        for person, rows in zip(lab.people, trace, strict=True):
            rows.append((person.core.position_m[0], person.core.force_n[0]))

    lab.run(watch)
    for person, rows in zip(lab.people, trace, strict=True):
        place, force = np.array(rows).T
        core = person.core
        assert core.work_j == pytest.approx(float(np.sum(force[:-1] * np.diff(place))), rel=1e-9)
        assert core.leak_j == pytest.approx(core.work_j - core.coupling.port_j, abs=1e-12)
        assert core.least_leak_j <= core.leak_j
