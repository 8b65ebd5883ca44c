"""Effects of the client in C: rendered as the reference renders them, refused as it refuses them, told in sessions."""

from ctypes import c_double
from math import nan
from random import Random
from typing import Any

import msgpack
import msgspec
import pytest
from msgspec.structs import replace

from cogrip.client.effects.effect_force import EffectForce
from cogrip.client.hand.frame import HandFrame
from cogrip.client.sources.force_source import AtHand, ForceSources
from cogrip.protocol.settings.effects import EFFECT_KINDS, MOST_POINTS, Effect, EffectKind
from cogrip.protocol.wire.messages import Effects, decode, encode

from tests.client.seated_client import capability
from tests.clients.compiled import AXES, needs_compiler
from tests.clients.test_c_sessions import PEAK_N, SLEW_N
from tests.clients.virtual_session import HZ, VirtualSession
from tests.extent import every
from tests.protocol.test_spec_vectors import VECTORS

pytestmark = needs_compiler

TICK_S = 1.0 / HZ
LAG_S, CARRIED_NSPM, BASE_NSPM, SPEED_MPS, SLEW_NPS, FREE_J = 4.0 * TICK_S, 12.0, 5.0, 1.0, 1000.0, 0.008
KINDS = tuple(EFFECT_KINDS)
COUNTS = {"late effects": 20, "unfit effect": 21, "": -1}  # of cogrip.h
STATE = ("level_j", "least_j", "drawn_j", "overdrawn_j")


def drawn(random: Random, kind: EffectKind) -> Effect:
    """Return an effect, one in four of which does not fit."""

    def row(size: float) -> tuple[float, float, float]:
        x, y, z = (random.uniform(-size, size) for _ in range(3))
        return x, y, z

    x, y, z = (random.choice((0.0, random.uniform(0.005, 0.05))) for _ in range(3))
    points = tuple(row(0.04) for _ in range(2 if kind == "channel" else random.randint(2, MOST_POINTS)))
    made = Effect(
        kind, row(0.02), (x, y, z), random.choice(((0.0, 0.0, 0.0), row(1.0))) if kind == "zone" else row(1.0), points,
        random.choice((200.0, 2000.0, 2e4)), 6.0 if kind in ("viscous", "curl") else random.choice((0.0, 3.0, 30.0)),
        random.uniform(0.05, 3.0), random.uniform(1.0, 256.0), random.uniform(1e-3, 0.02), random.uniform(5e-3, 0.03),
        1.2 if kind == "constant" else random.choice((0.0, 1.5)), 0.1 if kind == "perturbation" else random.choice((0.0, 0.1)),
    )  # fmt: skip
    unfit = (
        {"radius_m": 1e-5},
        {"period_m": 1e-5},
        {"frequency_hz": 1e-4},
        {"seconds": 0.009, "force_n": 0.0, "points_m": points[:1], "direction": (0.0, 0.0, 1e-7)},
        {"stiffness_npm": 0.0, "damping_nspm": 0.0},
    )
    return replace(made, **random.choice(unfit)) if random.random() < 0.25 else made


class Pair:
    """The effects of one seat, in C and by the reference."""

    def __init__(self, library: Any, axes: int) -> None:
        self.library, self.axes = library, axes
        numbers = (TICK_S, CARRIED_NSPM, LAG_S, BASE_NSPM, SPEED_MPS, SLEW_NPS, FREE_J)
        library.probe_effects(axes, (c_double * 7)(*numbers))
        self.reference = EffectForce(axes, TICK_S, BASE_NSPM)
        record = capability(axes, speed_mps=SPEED_MPS)
        self.reference.fit(record, record, FREE_J)
        self.sources = ForceSources(self.reference)

    def tell(self, told: Effects, tick: int) -> str:
        datagram = encode(told)
        reason = self.reference.tell(told, tick)
        assert self.library.probe_effects_tell(datagram, len(datagram), tick) == COUNTS[reason]
        known = self.reference.known(told.numbers)
        assert known == tuple(number for number in told.numbers if self.library.probe_effects_know(number))
        return reason

    def tick(self, tick: int, held: list[float], start: list[float], end: list[float], gain: float,
             law: list[float]) -> list[float]:  # fmt: skip
        """Run a tick of both, gain below 0: without a law. Returns the force of all effects, by the one in C."""
        speed = [(b - a) / TICK_S for a, b in zip(start, end, strict=True)]
        out, rows = (c_double * (AXES + 8))(), [(c_double * AXES)(*row) for row in (held, start, end, speed, law)]
        self.library.probe_effects_tick(tick, *rows[:4], gain, rows[4], out)
        one, sources = self.reference, self.sources
        sources.enter(1, tuple(held), held, tuple(start), tuple(end))
        if gain < 0.0:
            one.begin_anew()
            asked = None
        else:
            at = AtHand(tick, tuple(end), speed, HandFrame(), gain, CARRIED_NSPM, CARRIED_NSPM / LAG_S)
            sources.wish_n = sources.added(law, at)
            asked = one.asked_n
            shares = [entry.share for entry in one._entries.values()]
            assert bool(out[AXES + 7]) is one.reduced or max(shares) < 1e-9  # one that rounding has ended a tick before
        assert list(out[: self.axes]) == pytest.approx(asked or [0.0] * self.axes, rel=1e-9, abs=1e-9)
        wanted = [*(getattr(one.tank, name) for name in STATE), one.work_j, one.held_j]
        assert list(out[AXES : AXES + 6]) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
        assert out[AXES + 6] == pytest.approx(
            one._less_ticks, abs=0.02 * tick + 3.0
        )  # rounding decides where a share is all but 0
        assert out[AXES] >= 0.0
        return list(out[: self.axes])


@pytest.mark.sample(3)
@pytest.mark.parametrize("seed", range(9))
def test_effects_are_rendered_as_the_reference_renders_them(library: Any, seed: int) -> None:
    """Effects come, end and are withdrawn; hand, ramp and coupling go on at random; now and then there is no law."""
    random, axes = Random(seed), 1 + seed % 3
    pair = Pair(library, axes)
    numbers: list[int] = []
    place, speed, gain = [0.0] * axes, [0.0] * axes, 0.0
    held = [0.0] * axes
    refused, felt, version = [], 0, 0
    for tick in range(1500):
        if random.random() < 0.02:
            version = max(0, version + random.choice((1, 1, 1, -1, 0)))
            number = random.randint(1, 400)
            numbers = [*[each for each in numbers if random.random() < 0.9][-15:], number]
            effect = drawn(random, random.choice(KINDS))
            refused.append(
                pair.tell(Effects(1, version, tuple(numbers), random.choice((0.0, 1.0, 10.0)), number, effect), tick)
            )
            version = max(version, pair.reference._version)
        if random.random() < 0.002:
            pair.reference.forget()
            library.probe_effects_forget()
            version = 0
        before = list(place)
        for axis in range(axes):
            speed[axis] += random.uniform(-0.03, 0.03) - 0.02 * speed[axis] - 0.5 * place[axis]
            place[axis] += speed[axis] * TICK_S
        gain = min(1.0, gain + TICK_S / 0.3) if random.random() < 0.995 else max(0.0, gain - 0.2)
        law = [random.uniform(-1.0, 1.0) for _ in range(axes)]
        absent = random.random() < 0.003
        asked = pair.tick(tick, held, before, place, -1.0 if absent else gain, law)
        felt += any(asked)
        held = [random.choice((gain, 0.5 * gain)) * (a + b) for a, b in zip(asked, law, strict=True)]
    assert felt > 200
    assert {"", "unfit effect"} <= set(refused)


def mutants(random: Random) -> list[bytes]:
    """Return messages of effects with one thing wrong, or another order, length or type."""
    whole: list[Any] = list(msgpack.unpackb(VECTORS["effects"][0]))
    bad = (nan, float("inf"), -1.0, 1e9, "x", None, True, [], [0.0] * 3, [0.0] * 4, {}, -(2**60), 2**63)
    found = [whole[:length] for length in range(3, 8)] + [[*whole, 0]]
    for place in range(1, 7):
        found += [[*whole[:place], value, *whole[place + 1 :]] for value in bad]
    found.append([*whole[:3], list(range(17)), *whole[4:]])
    for key in (*Effect.__struct_fields__, "other", "points"):
        found += [[*whole[:6], {**whole[6], key: value}] for value in (*bad, [[0.0] * 3] * 8, [[0.0] * 3] * 9, [[0.0]])]
    found.append([*whole[:6], {key: value for key, value in whole[6].items() if key != "kind"}])
    found += [[*whole[:6], dict(reversed(whole[6].items()))]]
    datagrams = [msgpack.packb(each) for each in found]
    for _ in range(2000):
        data = bytearray(VECTORS["effects"][0])
        data[random.randrange(2, len(data))] = random.randrange(256)
        datagrams.append(bytes(data))
    return datagrams


def test_malformed_effects_are_refused_as_the_reference_refuses_them(library: Any) -> None:
    taken = 0
    for datagram in mutants(Random(5)):
        try:
            read = decode(datagram)
        except (msgspec.MsgspecError, ValueError):
            read = None
        found = library.probe_decode(datagram, len(datagram))
        assert bool(found) is (read is not None), (msgpack.unpackb(datagram, strict_map_key=False), datagram.hex())
        taken += bool(found)
    assert taken > 100


EFFECTS: dict[str, dict[str, Any]] = {
    "zone": {"kind": "zone", "place_m": (0.02, 0.0, 0.0), "direction": (-1.0, 0.0, 0.0), "stiffness_npm": 600.0},
    "vibration": {"kind": "vibration", "direction": (1.0, 0.0, 0.0), "amplitude_n": 0.3, "frequency_hz": 80.0},
    "texture": {"kind": "texture", "direction": (1.0, 0.0, 0.0), "amplitude_n": 0.3, "period_m": 0.004},
    "viscous": {"kind": "viscous", "damping_nspm": 4.0},
    "constant": {"kind": "constant", "direction": (-1.0, 0.0, 0.0), "force_n": 0.5},
    "perturbation": {
        "kind": "perturbation",
        "direction": (1.0, 0.0, 0.0),
        "amplitude_n": 0.5,
        "seconds": 0.2,
        "start_s": 0.4,
    },
    "spring": {
        "kind": "spring",
        "place_m": (0.02, 0.0, 0.0),
        "stiffness_npm": 100.0,
        "damping_nspm": 3.0,
        "force_n": 1.0,
    },
}


@pytest.mark.parametrize("name", every(2, EFFECTS))
def test_a_session_tells_effects_and_accounts_for_them(library: Any, name: str) -> None:
    session = VirtualSession(
        library, "anna", loss=0.1, jitter_ticks=8, effects=[EFFECTS[name], {**EFFECTS["vibration"], "start_s": 0.5}]
    )
    account = session.leave(1.5)
    assert account.effects is not None
    assert account.effects.least_tank_j >= 0.0
    assert account.effects.drawn_j > 0.0
    assert account.device.margin_j >= 0.0
    assert session.largest_step_n() <= SLEW_N
    assert 0.1 < session.person.status.peak_force_n <= PEAK_N * (1.0 + 1e-12)
    assert session.sends_what_the_reference_would()
    assert set(session.messages(Effects)[-1].numbers) == {1, 2}
    assert "unexpected" not in session.person.counts


def test_a_zone_is_felt_in_a_session_as_stiff_as_told(library: Any) -> None:
    """The hand is pulled 40 mm into it, and rests where the spring of its own and the zone hold each other."""
    session = VirtualSession(library, "anna", effects=[{**EFFECTS["zone"], "damping_nspm": 5.0}])
    session.run(1.0)
    depth_m = session.person.status.position_m[0] - 0.02
    assert depth_m > 0.009
    assert session.person.force_n[0] == pytest.approx(600.0 * depth_m, rel=0.02)
    assert session.leave().device.at_limit == 0.0
