"""Playout "auto" against the best fixed depth with hindsight on every named network, and in whole sessions."""

from functools import cache
from itertools import product
from typing import Any, get_args

import pytest

from cogrip.client.inputs import CloseLedger
from cogrip.protocol.line.delays import expected_frames, one_way
from cogrip.protocol.line.jitter_buffer import HYSTERESIS, cost, weight_frames
from cogrip.protocol.link_profile import Link, LinkProfile
from cogrip.protocol.network_profiles import ProfileName
from cogrip.protocol.rates import Rates
from cogrip.protocol.settings import Playout, resolve
from cogrip.sim.session.laboratory import Laboratory

from tests.bench.playout_trial import Arrivals, arrivals, beaten, best_fixed, fixed_delays, lateness, play, ratio
from tests.extent import every
from tests.sim.session_measures import allowed

BOUND = 1.2
RATES = Rates(512, 128)
PROFILES = get_args(ProfileName)


def link_of(name: str, direction: Any) -> LinkProfile:
    return Link(profile=name).direction(direction)


@cache
def runs_of(link: LinkProfile) -> tuple[Arrivals, ...]:
    """Three runs of a minute."""
    return tuple(arrivals(link, f"{seed}", 60.0, 128) for seed in (1, 2, 3))


@pytest.mark.parametrize(("name", "direction"), every(4, product(PROFILES, ("up", "down"))))
def test_auto_is_as_good_as_the_best_fixed_depth_with_hindsight(name: str, direction: str) -> None:
    """Three runs of a minute; `dev.py bench playout` does twenty. The constant part of the link's delay counts for nothing."""
    runs = runs_of(link_of(name, direction))
    ours = [play(run, "auto") for run in runs]
    delays = fixed_delays(runs)
    best = best_fixed(delays, 128)
    delay = sum(one.delay_frames for one in ours) / len(ours)
    late = sum(one.late for one in ours)
    constant = link_of(name, direction).delay_ms * 0.128
    assert delay - constant <= BOUND * (best.delay_frames - constant)
    # where the best loses next to nothing, one frame more a minute is what a frame's chance is
    assert late <= max(BOUND * best.late, best.late + len(runs))
    assert not beaten(delays, delay, late / best.sent, BOUND)


@pytest.mark.parametrize("hz", [32, 512])
def test_other_frame_rates_cost_as_little(hz: int) -> None:
    """Two depths are often as good as alike there: delay and late frames are judged together, with the hysteresis allowed."""
    runs = [arrivals(link_of("satellite", "down"), f"{seed}", 12.0, hz) for seed in (1, 2)]
    ours = [play(run, "auto") for run in runs]
    delays = fixed_delays(runs)
    late = sum(one.late for one in ours) / sum(one.sent for one in ours)
    delay = sum(one.delay_frames for one in ours) / len(ours)
    assert cost(delay, late, 1.0 - late, weight_frames(1.0 / hz)) <= best_fixed(delays, hz).cost(hz) + HYSTERESIS
    assert not beaten(delays, delay, late, BOUND)


@pytest.mark.parametrize(
    "link",
    [
        *(link_of(name, "up") for name in PROFILES),
        LinkProfile(delay_ms=20.0, jitter_ms=20.0),
        LinkProfile(delay_ms=20.0, loss=0.3, burst_frames=4.0),
        LinkProfile(delay_ms=20.0, jitter_ms=50.0, loss=0.5),
        LinkProfile(delay_ms=20.0, jitter_ms=3.0, reorder=0.1, duplicate=0.3),
    ],
)
def test_what_is_expected_is_what_is_best(link: LinkProfile) -> None:
    """The forecast against arrivals: its delay costs at most a tenth of a frame more than the best one."""
    runs = runs_of(link)
    delays = {one.delay_frames: one for one in fixed_delays(runs)}
    rates = Rates(1024, 128)
    frames = one_way(link.delay_ms, expected_frames(Playout(frames="auto"), link, rates), rates).frames
    best = best_fixed(list(delays.values()), 128)
    assert delays[frames].cost(128) <= best.cost(128) + 0.1


def test_hindsight_is_counted_from_the_arrivals() -> None:
    run = Arrivals(128, ((), (0,), (), (2,), (3,), (4, 4)))
    assert lateness(run) == {1: 4, 2: 1}  # frame 1 comes with datagram 2, at take 3; frame 5 does not come
    one, two = fixed_delays([run, run])
    assert (one.delay_frames, one.sent, one.late, one.lost) == (1, 12, 2, 2)
    assert (two.delay_frames, two.sent, two.late, two.lost) == (2, 12, 0, 2)
    assert best_fixed([one, two], 128) is two
    assert one.cost(128) == 1 + 64 * 2 / 8


def test_beaten_is_by_more_than_the_factor_in_both() -> None:
    one = best_fixed(fixed_delays([Arrivals(128, ((), (0,), (), (2,), (3,), (4,)))])[:1], 128)
    share = one.late / one.sent
    assert beaten([one], 1.21, 1.21 * share)
    assert not beaten([one], 1.19, 10.0)
    assert not beaten([one], 10.0, 1.19 * share)
    assert (ratio(0.0, 0.0), ratio(1.0, 0.0), ratio(3.0, 2.0)) == (1.0, float("inf"), 1.5)


@pytest.mark.parametrize("name", ["wifi", "satellite"])
def test_a_session_stays_passive_and_comes_to_the_depth_that_is_expected(name: str) -> None:
    table = {
        "seconds": 6.0,
        "rates": {"device_hz": RATES.device_hz},
        "link": {"profile": name},
        "playout": {"frames": "auto"},
        "coupling": {"stiffness_npm": 5000.0},
        "users": [{"name": "anna"}, {"name": "ben", "hand": "hold"}],
    }
    lab = Laboratory(resolve(table))
    lab.run()
    assert not lab.diverged
    for seat, person in enumerate(lab.people):
        assert person.core.coupling.down_margin_j + allowed("down_margin_j") >= -1e-12
        up = lab.room.seat_account(seat)
        assert up.up_margin_j + allowed("up_margin_j") >= -1e-12
        down = person.core.handle(CloseLedger(lab.ticks()), person.core.now_ns)
        for direction, account in (("up", up.playout), ("down", down.playout)):
            expected = expected_frames(Playout(frames="auto"), link_of(name, direction), RATES)
            assert account.depth_frames == pytest.approx(expected, abs=1.5)
            assert account.most_frames >= account.depth_frames >= account.least_frames


def test_without_jitter_auto_plays_what_no_playout_plays() -> None:
    """Bit by bit: the default of a link that is as long as it is."""
    forces = []
    for frames in (0, "auto"):
        table = {
            "seconds": 1.0,
            "link": {"delay_ms": 20.0},
            "playout": {"frames": frames},
            "users": [{"name": "anna"}, {"name": "ben"}],
        }
        felt: list[tuple[float, ...]] = []
        lab = Laboratory(resolve(table))
        lab.run(each_frame=lambda lab, felt=felt: felt.extend(tuple(person.core.force_n) for person in lab.people))
        forces.append(felt)
    assert forces[0] == forces[1]
    assert any(force[0] for force in forces[0])
