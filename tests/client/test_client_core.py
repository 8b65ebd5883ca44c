"""One person's client without I/O: exact books, no drift, skipped ticks, a stale link."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.core import RECKON_TICKS, ClientCore
from cogrip.client.rest import SAMPLES, RestStiffness
from cogrip.client.velocity import AlphaBeta, memory_for
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.devices.device import Capability, Sample
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


def capability(axes: int = 1, gives_velocity: bool = True, latency: int = 0) -> Capability:
    return Capability(
        family="test", model="arm", axes=axes, workspace_m=((-1.0, 1.0),) * axes, peak_force_n=100.0,
        continuous_force_n=2.0, stiffness_npm=1e3, damping_nspm=10.0, slew_nps=math.inf, speed_mps=math.inf,
        resolution_m=0.0, apparent_mass_kg=0.1, rate_hz=8192, gives_velocity=gives_velocity,
        latency_ticks=latency,
    )  # fmt: skip


class Client:
    """A seated core with a server of our own: what it sends is read back, waves are handed to it frame by frame."""

    def __init__(self, axes: int = 1, gives_velocity: bool = True, latency: int = 0, **coupling: object) -> None:
        settings = resolve({"object": {"axes": axes}, "coupling": coupling, "users": [{"name": "anna"}]})
        hello = make_hello(
            software="test", nonce=1, room="", name="", digest="", device="test", axes=axes, rate_hz=1024.0
        )  # fmt: skip
        self.core = ClientCore(hello, capability(axes, gives_velocity, latency))
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

    def tick(self, number: int, *position_m: float, velocity: Sequence[float] = (), age: int = 0) -> tuple[float, ...]:
        now_ns = due_ns(0, number, DEVICE_HZ)
        speed = tuple(velocity) or (0.0,) * self.axes
        self.core.sense(number, Sample(position_m, speed, age), now_ns)
        return self.core.act(now_ns)

    def total(self) -> float:
        """sum u T_c of all ticks so far, as it went into frames; one axis, boxcar."""
        sender, unsent = self.waves._sender, sum(self.waves._decimator._sum)  # type: ignore[attr-defined]
        return (sum(sender._total) + sum(wave for (wave,) in sender._recent)) * T_N + unsent * T_C

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
    returned = sum(held[(tick - 1) // M] for tick in range(1, number + 1))
    assert client.total() == pytest.approx(ROOT * (x - 0.02) - returned * T_C, abs=1e-12)


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


# Old samples ---------------------------------------------------------------------------------------------------------

LATENCIES = st.integers(0, 2)
GAPS = st.lists(st.integers(1, 12) | st.just(1), min_size=20, max_size=80)


class OldHand:
    """A hand whose samples are `latency` ticks old, and what each tick of its own time was: place, force, wave."""

    def __init__(self, latency: int, seed: int, **coupling: object) -> None:
        self.client, self.latency = Client(latency=latency, **coupling), latency
        self.random = np.random.default_rng(seed)
        self.now = 0
        self.place = [0.01] * (latency + 1)  # at ticks -latency to now
        self.force = [0.0] * latency  # over the tick that begins at each of them
        self.wave = [0.0] * latency
        self.estimate = [0.0] * latency
        self.mean: list[float] = []  # displacement over each tick, as far as samples tell
        self._frame = 0.0
        self.run(0)

    def run(self, gap: int, speed: float | None = None) -> None:
        """The next tick that is run, `gap` ticks on, with what is true of those between."""
        client, random, L = self.client, self.random, self.latency
        before, self.now = self.now, self.now + gap
        for tick in range(before + 1, self.now + 1):
            self.place.append(self.place[-1] + (float(random.uniform(-1e-4, 1e-4)) if speed is None else speed * T_C))
            self.force.append(client.core.force_n[0])
            self.estimate.append(client.core.velocity_mps[0])
            self.wave.append(self._frame)
            if tick % M == 0:
                self._frame = float(random.uniform(-0.3, 0.3))
                client.hear(due_ns(0, tick, DEVICE_HZ), self._frame)
        estimate = float(random.uniform(-0.1, 0.1)) if speed is None else speed
        client.tick(self.now, self.place[-1 - L], velocity=[estimate], age=L)
        self.mean += [(self.place[-1 - L] - self.place[-1 - L - gap]) / gap] * gap if gap else []

    def leak(self, since: int = 0) -> float:
        """sum (F - b y + sqrt(2b) v) y T_c of the ticks booked after tick `since`, each with the force and wave of its time."""
        rows = zip(self.mean, self.force, self.wave, strict=False)
        return sum((force - 20.0 * step / T_C + ROOT * wave) * step for step, force, wave in list(rows)[since:])


@given(LATENCIES, GAPS, st.integers(0, 2**32 - 1))
def test_displacement_force_and_wave_of_one_tick_are_booked_together(latency: int, gaps: list[int], seed: int) -> None:
    """Of any age, with ticks skipped and forces limited: leak = sum (F - b y + sqrt(2b) v) y T_c, force and wave of then."""
    hand = OldHand(latency, seed)
    for gap in [M, *gaps]:
        hand.run(gap)
        if hand.random.random() < 0.2:
            hand.client.core.acted((0.5 * hand.client.core.force_n[0],))
    core, waves = hand.client.core, hand.client.waves
    work = sum(force * step for step, force in zip(hand.mean, hand.force, strict=False))
    assert core.work_j == pytest.approx(work, rel=1e-9, abs=1e-14)
    assert core.work_j - (waves.made_j - waves.used_j) == pytest.approx(core.leak_j, rel=1e-9, abs=1e-13)
    assert core.leak_j == pytest.approx(hand.leak(), rel=1e-9, abs=1e-13)
    used = sum(wave**2 for wave in hand.wave[: hand.now]) * T_C / 2.0  # from `latency` ticks before the first one on
    assert waves.used_j == pytest.approx(used, rel=1e-9, abs=1e-15), "each wave for all its ticks, and no other"


@given(LATENCIES, st.integers(0, 2**32 - 1))
def test_with_the_force_let_through_only_the_dampers_error_leaks(latency: int, seed: int) -> None:
    """leak = sum b (y_est - y) y T_c (theory section 3.6), y_est what the force of that tick was made of: at any age."""
    hand, start = OldHand(latency, seed), 400  # the ramp is behind us
    for _ in range(start):
        hand.run(1)
    before = hand.client.core.leak_j
    for _ in range(200):
        hand.run(1)
    rows = list(zip(hand.mean, hand.estimate, strict=False))[start:]
    leak = sum(20.0 * (estimate - step / T_C) * step for step, estimate in rows)
    assert hand.client.core.leak_j - before == pytest.approx(leak, rel=1e-9, abs=1e-13)


@given(LATENCIES, GAPS, st.integers(0, 2**32 - 1))
def test_virtual_coupling_books_a_displacement_with_the_force_it_was_made_against(
    latency: int, gaps: list[int], seed: int
) -> None:
    """Once the force is let through, nothing leaks."""
    client, random = Client(latency=latency, kind="coupling"), np.random.default_rng(seed)
    places, now, before = [0.0] * (latency + 1), 0, 0.0
    for gap in [1] * 400 + gaps:
        now += gap
        for _ in range(gap):
            places.append(places[-1] + float(random.uniform(-1e-5, 1e-5)))
        state = State(7, now, (float(random.uniform(-0.01, 0.01)),), (0.0,), 0.0, 0, Stamp(now))
        client.core.receive(messages.encode(state), due_ns(0, now, DEVICE_HZ))
        client.tick(now, places[-1 - latency], velocity=[0.01], age=latency)
        if now == 400:
            before = client.core.leak_j
    assert client.core.coupling.port_j != 0.0
    assert client.core.leak_j == pytest.approx(before, abs=1e-12)


@given(LATENCIES, st.integers(1, 60), st.integers(1, 60))
def test_a_fault_absorbs_each_wave_for_its_own_ticks_too(latency: int, well: int, ill: int) -> None:
    hand = OldHand(latency, 5)
    for number in range(well + ill + 40):
        if number == well:
            hand.client.core.fail("a test")
        if number == well + ill:
            hand.client.core.rearm()
        hand.run(1)
        used = sum(wave**2 for wave in hand.wave[: hand.now]) * T_C / 2.0
        assert hand.client.waves.used_j == pytest.approx(used, rel=1e-9, abs=1e-15)


@given(LATENCIES, st.lists(st.integers(1, 12), min_size=10, max_size=60), st.integers(0, 2**32 - 1))
def test_whatever_is_reckoned_the_sum_of_displacement_is_exact(latency: int, gaps: list[int], seed: int) -> None:
    """No sample, an older one, ticks skipped: sum u T_c = sqrt(2b) (x - x_0) - sum v T_c once a sample is as old as usual."""
    client, random = Client(latency=latency), np.random.default_rng(seed)
    gaps = [M, *gaps, 1]  # the first frame alone: it sets the playout
    path = np.cumsum(random.uniform(-1e-4, 1e-4, sum(gaps) + latency + 2)).tolist()
    client.tick(0, path[0], age=latency)
    wave, now, returned = 0.0, 0, [0.0] * latency
    for number, gap in enumerate(gaps):
        last, now = now, now + gap
        for tick in range(last + 1, now + 1):
            returned.append(wave)
            if tick % M == 0:
                wave = float(random.uniform(-0.3, 0.3))
                client.hear(due_ns(0, tick, DEVICE_HZ), wave)
        if gap < 3 and 0 < number < len(gaps) - 1 and random.random() < 0.2:
            now_ns = due_ns(0, now, DEVICE_HZ)
            client.core.sense(now, None, now_ns)
            client.core.act(now_ns)
            continue
        age = latency if number == len(gaps) - 1 else latency + min(now - latency, int(random.integers(0, gap + 1)), 8)
        client.tick(now, path[now - age], velocity=[float(random.uniform(-0.2, 0.2))], age=age)
    assert client.core.safety.state == "live"
    expected = ROOT * (path[now - latency] - path[0]) - sum(returned[:now]) * T_C
    assert client.total() == pytest.approx(expected, abs=1e-12)


@given(st.lists(st.integers(1, 60), min_size=1, max_size=12))
def test_a_loop_that_was_late_makes_no_jump_of_a_hand_that_went_on(gaps: list[int]) -> None:
    """A device that answers what it was asked at the last tick that was run: its sample is as old as the gap."""
    client, now, speed = Client(latency=1), 0, 1e-4 / T_C
    for gap in [1] * 400 + gaps + [1] * 3:
        last, now = now, now + gap
        if now == 400:
            start = client.core.leak_j
        for tick in range(last // M, now // M):
            client.hear(due_ns(0, tick * M, DEVICE_HZ), 0.0)
        client.tick(now, 1e-4 * last, velocity=[speed], age=gap)
    assert client.total() == pytest.approx(ROOT * 1e-4 * (now - 1), rel=1e-9), (
        "the first tick shows what was before the hand"
    )
    assert client.waves.made_j == pytest.approx(20.0 * speed**2 * T_C * (now - 1), rel=1e-9), "the least that it may be"
    assert client.core.leak_j == pytest.approx(start, abs=1e-12), "the damper's error is none"


def test_the_record_says_what_the_core_estimates_with() -> None:
    """A device may say only once it is open that it gives no velocity, how light it is, and how old its samples are."""
    light = replace(capability(gives_velocity=False, latency=1), apparent_mass_kg=0.03)
    client = Client()
    client.core.equip(light)
    estimator = AlphaBeta(1, T_C, memory_for(light, T_C))
    random = np.random.default_rng(8)
    expected: Sequence[float] = ()
    for number, place in enumerate(random.uniform(-1e-4, 1e-4, 50).tolist()):
        client.core.sense(number, Sample((place,), None, 1), due_ns(0, number, DEVICE_HZ))
        client.core.act(due_ns(0, number, DEVICE_HZ))
        expected = estimator.update((place,))
    assert list(client.core.velocity_mps) == expected
    assert memory_for(light, T_C) == 0.5
    assert len(client.waves._late) == 1


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
