"""Hostile servers and devices: no force above the device's limit reaches the hand, and none that is not finite."""

import math
from random import Random

import pytest

from cogrip.client.core import ClientCore
from cogrip.client.inputs import Connect, Rearm
from cogrip.devices.device import Sample
from cogrip.devices.registry import make
from cogrip.protocol.wire.messages import Power, Stamp, Waves, encode

from tests.client.seated_client import at_ns, hello, seat, welcome
from tests.extent import every

SESSION = 7


def seated(axes, **coupling):
    capability = make("sim:phantom", axes=axes).capability
    core = ClientCore(hello(axes=axes, rate_hz=float(capability.rate_hz)), capability)
    core.handle(Connect(), 0)
    core.receive(welcome(seat(object={"axes": axes}, coupling=coupling), SESSION), 0)
    return core


def reals(chance, count, high, low=None):
    return tuple(chance.uniform(-high if low is None else low, high) for _ in range(count))


def stamp(chance):
    return Stamp(*[chance.randint(0, 2**60) for _ in range(3)])


def hostile_waves(chance, axes, tick):
    sums, frames = (reals(chance, axes, 1e15) for _ in range(2)), chance.randint(1, 8)
    return Waves(
        SESSION, chance.randint(0, tick // 8 + 3), reals(chance, frames * axes, 1e4), *sums, 0.0, 0.0,
        chance.randint(0, 2**40), stamp(chance), reals(chance, 2 * axes, 1e4),
    )  # fmt: skip


def hostile_power(chance, axes, tick):
    number = chance.randint(0, tick // 8 + 3)
    rows = [reals(chance, axes, high, low) for low, high in ((-1e3, 1e3), (-1e4, 1e4), (-1e9, 1e9), *[(0.0, 1e15)] * 2)]
    return Power(SESSION, number, *rows, 1e15, chance.randint(0, 2**40), stamp(chance))


@pytest.mark.parametrize(
    ("seed", "kind", "said"),
    [
        *every(3, ((seed, "wave", hostile_waves) for seed in range(12))),
        *every(5, ((seed, "tdpa", hostile_power) for seed in range(6))),
    ],
)
def test_no_force_beyond_the_limit_whatever_comes(seed, kind, said):
    chance = Random(seed)
    axes = chance.randint(1, 3)
    core = seated(axes, impedance_nspm=10 ** chance.uniform(0, 4), stiffness_npm=1e7, kind=kind)
    limit_n = core.capability.peak_force_n * (1 + 1e-12)
    tick, faults = 0, 0
    for _ in range(2500):
        tick += chance.choice((2, 50, 200)) if chance.random() < 0.003 else 1
        reading = [chance.gauss(0.0, 1e-4) for _ in range(axes)]
        if chance.random() < 0.002:
            reading[0] = chance.choice((math.nan, math.inf, 1e9))
        sample = None if chance.random() < 0.02 else Sample(tuple(reading), None)
        core.sense(tick, sample, at_ns(tick))
        if chance.random() < 0.3:
            core.receive(encode(said(chance, axes, tick)), at_ns(tick))
        force = core.act(at_ns(tick))
        assert math.hypot(*force) <= limit_n, "nan fails this too"
        if core.safety.state == "fault" and chance.random() < 0.02:
            faults += 1
            core.handle(Rearm(), core.now_ns)
    assert faults > 0
    assert core.seated.peaks.force_n > 0.0


def test_a_bad_number_does_not_outlive_its_fault():
    core = seated(1)
    for tick in range(60):
        if tick == 40:
            assert core.safety.state == "fault"
            core.handle(Rearm(), core.now_ns)
        core.sense(tick, Sample((math.nan if tick == 20 else 0.001,), None), at_ns(tick))
        core.act(at_ns(tick))
    assert core.safety.state == "live"
    assert all(math.isfinite(speed) for speed in core.velocity_mps)
