"""People come and go, lose their address or their server, while others hold on and move: nobody is jolted, nothing is made.

All in virtual time.
"""

import math
from collections.abc import Callable
from itertools import product
from random import Random
from typing import Any

import pytest

from cogrip.client.inputs import CloseLedger
from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.devices.device import MOST_SLOPE_NPS
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.session import QUIET_NS
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.felt_forces import Felt
from tests.sim.session_measures import allowed

MOST_STEP_N = 0.5
SOFT_N = SOFT_SLOPE_NPS / 1024
NOTHING_J = -1e-12
DIRECTIONS = ("1", "1,0.5", "1,0.5,0.25")


def world(kind: str, axes: int, hands: list[str], **more: Any) -> Settings:
    """One object, a person a hand, 10 ms of delay each way."""
    sides = ("left", "right", "left")
    users = [
        {"name": name, "device": "sim:ideal", "hand": hand, "side": side}
        for name, hand, side in zip("abc", hands, sides, strict=False)
    ]
    table = {"seconds": 1e3, "object": {"kind": kind, "axes": axes}, "playout": {"frames": 2}, "users": users}
    return resolve({**table, "link": {"delay_ms": 10, **more.pop("link", {})}, **more})


def reaching(axes: int, amplitude_mm: float) -> str:
    return f"reach&amplitude_m={amplitude_mm * 1e-3}&direction={DIRECTIONS[axes - 1]}"


def pulling(axes: int, keys: str = "amplitude_m=0.02&frequency_hz=1") -> list[str]:
    """Two who swing against each other, so that forces go to and fro."""
    there = DIRECTIONS[axes - 1]
    back = ",".join(f"-{each}" for each in there.split(","))
    return [f"sine&{keys}&direction={direction}" for direction in (there, back)]


def pressing(axes: int) -> list[str]:
    """Two who press against each other, now more, now less, and hardly ever let go."""
    return pulling(axes, "amplitude_m=0.008&offset_m=0.012&frequency_hz=1")


def least_margin(laboratory: Laboratory) -> float:
    """Return by how much the least margin of all lines of the people seated now is above what the credit allows [J]."""
    room = laboratory.room
    told = [("down_margin_j", person.core.coupling.down_margin_j) for person in laboratory.people]
    for number, seat in enumerate(room.seats):
        account = room.seat_account(number)
        told += [(key, getattr(account, key)) for key in ("up_margin_j", "line_margin_j")]
        assert seat.settings.user == laboratory.people[number].name
    return min(margin_j + allowed(key) for key, margin_j in told if margin_j is not None)


def seated(laboratory: Laboratory) -> Callable[[], bool]:
    return lambda: all(person.core.session.state == "seated" for person in laboratory.people)


# Joining and leaving --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "axes", "visits"),
    [long("cube", 1, 1), ("faces", 3, 2), *(long(*each, 25) for each in product(("cube", "faces"), (1, 3)))],
)
def test_a_third_comes_and_goes_while_two_move(kind: str, axes: int, visits: int) -> None:
    """The third begins its strokes anew with each visit, against those of the others."""
    laboratory = Laboratory(world(kind, axes, [reaching(axes, 20.0)] * 3))
    felt, random = Felt(laboratory, 0, 1), Random(f"{kind} {axes}")
    felt.run(random.randrange(60, 120))
    goodbyes = []
    for _ in range(visits):
        leaver = laboratory.people[2]
        laboratory.leave(2)
        took_s = felt.until(lambda leaver=leaver: leaver.core.session.state == "closed", 1.0)
        assert leaver.core.session.failed == ""
        goodbyes.append((took_s, leaver.core.coupling.down_margin_j))
        assert least_margin(laboratory) >= NOTHING_J, "with what the seat knew when it was left"
        felt.run(random.randrange(3, 20))
        laboratory.come(2)
        felt.run(random.randrange(20, 60))
        assert least_margin(laboratory) >= NOTHING_J
    assert all(margin is not None and margin + allowed("up_margin_j") >= NOTHING_J for _, margin in goodbyes)
    assert max(took_s for took_s, _ in goodbyes) < 0.7
    assert felt.step_n < MOST_STEP_N
    assert laboratory.people[2].visit == visits
    assert {person.core.session.resumed for person in laboratory.people} == {0}
    undisturbed = Laboratory(world(kind, axes, [reaching(axes, 20.0)] * 3))
    calm = Felt(undisturbed, 0, 1)
    calm.run(150)
    assert calm.step_n < felt.step_n, "the visits are felt"


# Another address ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", every(4, range(4)))
def test_who_loses_the_address_is_back_within_two_seconds_on_the_same_line(seed: int) -> None:
    random = Random(seed)
    laboratory = Laboratory(world("cube", 1 + 2 * (seed % 2), pulling(1 + 2 * (seed % 2))))
    felt = Felt(laboratory)
    felt.run(random.randrange(130, 260))
    core, before = laboratory.people[0].core, laboratory.people[0].address
    session = laboratory.room.seats[0].session
    laboratory.lose_address(0)
    felt.until(lambda: core.session.state == "resuming", 0.6)
    assert core.force_n == (0.0,) * len(core.force_n)
    felt = Felt(laboratory)  # from here on: the way back
    back_s = QUIET_NS * 1e-9 + felt.until(seated(laboratory), 2.0 - QUIET_NS * 1e-9)
    felt.run(150)
    assert felt.step_n < MOST_STEP_N
    assert back_s < 2.0
    assert (core.session.resumed, core.session.renewed) == (1, 0)
    assert laboratory.room.seats[0].session == session
    assert laboratory.people[0].address != before
    assert laboratory.room.seats[0].address == laboratory.people[0].address
    assert core.safety.state == "live"
    assert least_margin(laboratory) >= NOTHING_J
    count = core.handle(CloseLedger(laboratory.ticks()), core.now_ns).down
    assert count.lost > 0
    assert count.sent == count.applied + count.late + count.lost
    laboratory.lose_address(0)
    felt.until(lambda: core.session.resumed == 2, 2.0)
    felt.run(100)
    assert core.session.state == "seated"
    assert laboratory.people[1].core.session.resumed == 0
    assert least_margin(laboratory) >= NOTHING_J


# Another server -------------------------------------------------------------------------------------------------------


@pytest.mark.sample(1)
@pytest.mark.parametrize("seed", every(8, range(8)))
@pytest.mark.parametrize("concealment", ["zero", "elastic"])
def test_a_server_that_is_killed_jolts_nobody_and_lets_go_at_once(seed: int, concealment: str) -> None:
    """By what safety softens where the gap is not concealed; where it is, by the line itself."""
    random, axes = Random(seed), 1 + 2 * (seed % 2)
    laboratory = Laboratory(world("cube", axes, pulling(axes), playout={"frames": 2, "concealment": concealment}))
    felt = Felt(laboratory)
    felt.run(random.randrange(130, 260))
    felt.until(lambda: all(1.0 < math.hypot(*person.core.force_n) < 4.0 for person in laboratory.people), 1.0)
    killed = laboratory.tick
    laboratory.kill()
    felt.run(60)
    assert felt.step_n < MOST_STEP_N
    for person in laboratory.people:
        softened = person.core.safety.counts.get("gap softened", 0)
        assert concealment == "elastic" or softened >= math.floor((1.0 - MOST_STEP_N) / SOFT_N)
    assert all((felt.zero_since[number] - killed) / 1024 < 0.25 for number in range(2))


@pytest.mark.parametrize("seed", every(4, (3, 0, 1, 2)))
def test_a_server_that_is_started_anew_is_found_and_its_object_stands_where_it_was(seed: int) -> None:
    random, axes = Random(seed), 1 + 2 * (seed % 2)
    kind, hands = (("cube", pulling), ("faces", pressing))[seed // 2]
    laboratory = Laboratory(world(kind, axes, hands(axes)))
    felt = Felt(laboratory)
    felt.run(random.randrange(130, 260))
    checkpoints = laboratory.kill()
    away_s = random.uniform(0.2, 1.5)
    felt.run(round(away_s * 128))
    laboratory.restart(checkpoints)
    back_s = felt.until(seated(laboratory), 3.0 - away_s)
    there = laboratory.room.world.position.tolist()
    assert math.dist(there, checkpoints[0].position_m) < 1e-3
    felt.run(128)
    assert back_s < 1.0
    assert felt.step_n < MOST_STEP_N
    for person in laboratory.people:
        session = person.core.session
        assert (session.resumed + session.renewed, session.renewed) == (1, 1)
        assert person.core.safety.state == "live"
        assert person.core.ledger.leak_j == pytest.approx(
            person.core.ledger.work_j - person.core.ledger.port_j, abs=1e-12
        )
    assert least_margin(laboratory) >= NOTHING_J
    assert felt.peak_n > 1.0


# Bad links ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", every(4, range(4)))
@pytest.mark.parametrize("concealment", ["zero", "elastic"])
def test_bursts_of_loss_are_softened_and_make_nothing(seed: int, concealment: str) -> None:
    """By safety, or so far by the line that safety has nothing to do."""
    loss, playout = {"loss": 0.3, "burst_frames": 4, "jitter_ms": 10}, {"frames": 2, "concealment": concealment}
    settings = world("cube", 3, pulling(3), link=loss, seed=seed + 1, playout=playout)
    laboratory = Laboratory(settings, bare=concealment == "zero")  # the device port finds that this oscillates
    felt = Felt(laboratory)
    felt.run(250)
    assert least_margin(laboratory) >= NOTHING_J
    for person in laboratory.people:
        core = person.core
        assert concealment == "elastic" or core.safety.counts["gap softened"] > 0
        assert core.ledger.leak_j == pytest.approx(core.ledger.work_j - core.ledger.port_j, abs=1e-12)
        assert core.ledger.least_leak_j > -0.05, "what the device end gave"
    assert felt.peak_n < 8.0
    limited = sum(person.core.safety.counts.get("slew limited", 0) for person in laboratory.people)
    assert (limited == 0) is (concealment == "elastic")
    assert felt.step_n <= (2.0 * MOST_STEP_N if concealment == "elastic" else MOST_SLOPE_NPS / 1024 * (1.0 + 1e-9))


def test_a_clean_link_is_never_softened() -> None:
    laboratory = Laboratory(world("cube", 3, pulling(3)))
    Felt(laboratory).run(200)
    assert all(person.core.safety.counts == {} for person in laboratory.people)
