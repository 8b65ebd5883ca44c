"""Samples that are old when they are read: each is entered with the force and the wave it was made against."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.velocity import MotionObserver, memory_for
from cogrip.client.inputs import DeviceFailed, DeviceOpened, ForceApplied, Rearm
from cogrip.devices.device import Sample
from cogrip.protocol.wire import messages
from cogrip.protocol.wire.messages import Stamp, State

from tests.client.seated_client import ROOT, T_C, Client, M, at_ns, capability

LATENCIES = st.integers(0, 2)
GAPS = st.lists(st.integers(1, 12) | st.just(1), min_size=20, max_size=80)


class OldHand:
    """A hand whose samples are `latency` ticks old, and what each tick of its own time was: place, force, wave."""

    def __init__(self, latency: int, seed: int, size: float = 1.0, **coupling: object) -> None:
        """size: of waves and velocities; at 1 the forces are limited, too."""
        self.size = size
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
                self._frame = self.size * float(random.uniform(-0.3, 0.3))
                client.hear(at_ns(tick), self._frame)
        estimate = self.size * float(random.uniform(-0.1, 0.1)) if speed is None else speed
        client.tick(self.now, self.place[-1 - L], velocity=[estimate], age=L)
        self.mean += [(self.place[-1 - L] - self.place[-1 - L - gap]) / gap] * gap if gap else []

    def leak(self, since: int = 0) -> float:
        """sum (F - b y + sqrt(2b) v) y T_c of ticks after tick `since`, each with force and wave of its time."""
        rows = zip(self.mean, self.force, self.wave, strict=False)
        return sum((force - 20.0 * step / T_C + ROOT * wave) * step for step, force, wave in list(rows)[since:])


@given(LATENCIES, GAPS, st.integers(0, 2**32 - 1))
def test_displacement_force_and_wave_of_one_tick_are_entered_together(latency: int, gaps: list[int], seed: int) -> None:
    """At any age, with ticks skipped and forces limited, leak = sum (F - b y + sqrt(2b) v) y T_c, force and wave of then."""
    hand = OldHand(latency, seed)
    for gap in [M, *gaps]:
        hand.run(gap)
        if hand.random.random() < 0.2:
            hand.client.core.handle(ForceApplied((0.5 * hand.client.core.force_n[0],)), hand.client.core.now_ns)
    core, waves = hand.client.core, hand.client.waves
    work = sum(force * step for step, force in zip(hand.mean, hand.force, strict=False))
    assert core.ledger.work_j == pytest.approx(work, rel=1e-9, abs=1e-14)
    assert core.ledger.work_j - (waves.energy.made_j - waves.energy.used_j) == pytest.approx(
        core.ledger.leak_j, rel=1e-9, abs=1e-13
    )
    assert core.ledger.leak_j == pytest.approx(hand.leak(), rel=1e-9, abs=1e-13)
    used = sum(wave**2 for wave in hand.wave[: hand.now]) * T_C / 2.0  # from `latency` ticks before the first one on
    assert waves.energy.used_j == pytest.approx(used, rel=1e-9, abs=1e-15), "each wave for all its ticks, and no other"


@given(LATENCIES, st.integers(0, 2**32 - 1))
def test_with_the_force_let_through_only_the_dampers_error_leaks(latency: int, seed: int) -> None:
    """leak = sum b (y_est - y) y T_c (theory section 3.6), y_est what the force of that tick was made of: at any age."""
    hand, start, before = OldHand(latency, seed, size=0.04), 400, 0.0  # the ramp is behind us
    for number in range(600):
        if number == start:
            before = hand.client.core.ledger.leak_j
        hand.run(1)
    rows = list(zip(hand.mean, hand.estimate, strict=False))[start:]
    leak = sum(20.0 * (estimate - step / T_C) * step for step, estimate in rows)
    assert not hand.client.core.safety.counts
    assert hand.client.core.ledger.leak_j - before == pytest.approx(leak, rel=1e-9, abs=1e-13)


@given(LATENCIES, GAPS, st.integers(0, 2**32 - 1))
def test_virtual_coupling_enters_a_displacement_with_the_force_it_was_made_against(
    latency: int, gaps: list[int], seed: int
) -> None:
    """Nothing leaks once the force is let through."""
    client, random = Client(latency=latency, kind="coupling"), np.random.default_rng(seed)
    places, now, before = [0.0] * (latency + 1), 0, 0.0
    for gap in [1] * 400 + gaps:
        now += gap
        for _ in range(gap):
            places.append(places[-1] + float(random.uniform(-1e-5, 1e-5)))
        state = State(7, now, (float(random.uniform(-2e-4, 2e-4)),), (0.0,), 0.0, 0, Stamp(now))
        client.core.receive(messages.encode(state), at_ns(now))
        client.tick(now, places[-1 - latency], velocity=[0.01], age=latency)
        if now == 400:
            before = client.core.ledger.leak_j
    assert client.core.coupling.port_j != 0.0
    assert client.core.ledger.leak_j == pytest.approx(before, abs=1e-12)


@given(LATENCIES, st.integers(1, 60), st.integers(1, 60))
def test_a_fault_absorbs_each_wave_for_its_own_ticks_too(latency: int, well: int, ill: int) -> None:
    hand = OldHand(latency, 5)
    for number in range(well + ill + 40):
        if number == well:
            hand.client.core.handle(DeviceFailed("a test"), hand.client.core.now_ns)
        if number == well + ill:
            hand.client.core.handle(Rearm(), hand.client.core.now_ns)
        hand.run(1)
        used = sum(wave**2 for wave in hand.wave[: hand.now]) * T_C / 2.0
        assert hand.client.waves.energy.used_j == pytest.approx(used, rel=1e-9, abs=1e-15)


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
                client.hear(at_ns(tick), wave)
        if gap < 3 and 0 < number < len(gaps) - 1 and random.random() < 0.2:
            now_ns = at_ns(now)
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
    client, now, speed, start = Client(latency=1), 0, 1e-4 / T_C, 0.0
    for gap in [1] * 400 + gaps + [1] * 3:
        last, now = now, now + gap
        if now == 400:
            start = client.core.ledger.leak_j
        for tick in range(last // M, now // M):
            client.hear(at_ns(tick * M), 0.0)
        client.tick(now, 1e-4 * last, velocity=[speed], age=gap)
    gone = now - 1  # the first tick shows what was before the hand
    assert client.total() == pytest.approx(ROOT * 1e-4 * gone, rel=1e-9)
    least_j = 20.0 * speed**2 * T_C * gone
    assert client.waves.energy.made_j == pytest.approx(least_j, rel=1e-9), "the least that it may be"
    assert client.core.ledger.leak_j == pytest.approx(start, abs=1e-12), "the damper's error is none"


def test_the_record_says_what_the_core_estimates_with() -> None:
    """A device may say only once it is open that it gives no velocity, how light it is, and how old its samples are."""
    light = replace(capability(gives_velocity=False, latency=1), apparent_mass_kg=0.03)
    client = Client()
    client.core.handle(DeviceOpened(light), client.core.now_ns)
    estimator = MotionObserver(1, T_C, memory_for(light, T_C), (light.apparent_mass_kg,), 1)
    for number, place in enumerate(np.random.default_rng(8).uniform(-1e-4, 1e-4, 50).tolist()):
        estimator.hold(client.core.force_n, 1 if number else 0)
        client.core.sense(number, Sample((place,), None, 1), at_ns(number))
        client.core.act(at_ns(number))
        assert list(client.core.velocity_mps) == estimator.update((place,))
    assert memory_for(light, T_C) == 0.5
    assert client.waves.late.ticks == 1
