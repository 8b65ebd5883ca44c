"""Playout "auto" against the best fixed depth with hindsight on every named network, and in whole sessions."""

from collections.abc import Sequence
from functools import cache
from itertools import product
from statistics import mean
from typing import Any, get_args

import pytest

from cogrip.client.inputs import CloseLedger
from cogrip.protocol.line.receiver import LATE
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.link_profile import Link, LinkProfile
from cogrip.protocol.settings.network_profiles import ProfileName
from cogrip.protocol.settings.rates import Rates
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Playout
from cogrip.sim.laboratory import Laboratory

from tests.bench.playout_trial import TICKS, Arrivals, arrivals, beaten, best_fixed, fixed_delays, lateness, play, ratio
from tests.extent import every, long
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


def cost_of_auto(runs: Sequence[Arrivals]) -> tuple[float, float]:
    """Return the mean delay [ticks], and the share of frames that come too late."""
    ours = [play(run, "auto") for run in runs]
    return mean(one.delay_ticks for one in ours), sum(one.late for one in ours) / sum(one.sent for one in ours)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("name", "direction"), every(6, product(PROFILES, ("up", "down"))))
def test_auto_is_as_good_as_the_best_fixed_depth_with_hindsight(name: str, direction: str) -> None:
    """Three runs of a minute; `dev.py bench playout` does twenty. The constant part of the link's delay counts for nothing."""
    runs = runs_of(link_of(name, direction))
    delay, late = cost_of_auto(runs)
    delays = fixed_delays(runs)
    best = best_fixed(delays)
    constant = link_of(name, direction).delay_ms * 0.128 * TICKS
    assert delay - constant <= BOUND * (best.delay_ticks - constant)
    assert late <= BOUND * LATE
    assert not beaten(delays, delay, late, BOUND)


@pytest.mark.long
@pytest.mark.parametrize("hz", [32, 512])
def test_other_frame_rates_cost_as_little(hz: int) -> None:
    runs = [arrivals(link_of("satellite", "down"), f"{seed}", 12.0, hz) for seed in (1, 2)]
    delay, late = cost_of_auto(runs)
    delays = fixed_delays(runs)
    assert delay <= BOUND * best_fixed(delays).delay_ticks
    assert not beaten(delays, delay, late, BOUND)


@pytest.mark.sample(3)
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
    """The forecast against arrivals: to two ticks, or 5 % of what jitter adds."""
    best = best_fixed(fixed_delays(runs_of(link))).delay_ticks
    quickest = line_delay(Playout(frames="auto"), LinkProfile(delay_ms=link.delay_ms), Rates(1024, 128)).ticks
    expected = line_delay(Playout(frames="auto"), link, Rates(1024, 128)).ticks
    assert expected == pytest.approx(best, abs=max(2.0, 0.05 * (best - quickest)))


def test_hindsight_is_counted_from_the_arrivals() -> None:
    ticks: list[tuple[int, ...]] = [()] * (4 * TICKS)  # frames 0 to 3 are made
    ticks[3], ticks[2 * TICKS + 3], ticks[2 * TICKS + 5] = (0,), (2,), (2, 2)
    run = Arrivals(128, tuple(ticks))
    assert lateness(run) == {3: 2, TICKS + 3: 1}  # frame 1 comes with datagram 2; frame 3 does not come
    delays = fixed_delays([run, run])
    one, two = delays[0], delays[-1]
    assert (one.delay_ticks, one.sent, one.late, one.lost) == (3, 8, 2, 2)
    assert (two.delay_ticks, two.sent, two.late, two.lost) == (TICKS + 3, 8, 0, 2)
    assert best_fixed(delays) is two
    assert best_fixed(delays, 0.4) is one


def test_beaten_is_by_more_than_the_factor_in_both() -> None:
    one = fixed_delays([Arrivals(128, ((0,),) + ((),) * TICKS + ((1,),) + ((),) * TICKS + ((), (2,)))])[1]
    share = one.late / one.sent
    assert one.delay_ticks * share > 0.0
    assert beaten([one], 1.21 * one.delay_ticks, 1.21 * share)
    assert not beaten([one], 1.19 * one.delay_ticks, 10.0)
    assert not beaten([one], 10.0 * one.delay_ticks, 1.19 * share)
    assert (ratio(0.0, 0.0), ratio(1.0, 0.0), ratio(3.0, 2.0)) == (1.0, float("inf"), 1.5)


@pytest.mark.long
@pytest.mark.parametrize("name", [long("wifi"), "satellite"])
def test_a_session_stays_passive_and_comes_to_the_depth_that_is_expected(name: str) -> None:
    table = {
        "seconds": 9.0,
        "rates": {"device_hz": RATES.device_hz},
        "link": {"profile": name},
        "playout": {"frames": "auto"},
        "coupling": {"stiffness_npm": 5000.0},
        "users": [{"name": "anna"}, {"name": "ben", "hand": "hold"}],
    }
    lab = Laboratory(resolve(table))
    depths: dict[str, list[float]] = {"up": [], "down": []}

    def note(lab: Laboratory) -> None:
        if lab.seconds > 5.0:  # the first second decides with few frames
            depths["up"] += [
                port.playout_frames for seat in lab.room.seats if (port := seat.port) and port.playout_frames
            ]
            depths["down"] += [person.core.coupling.playout_frames or 0.0 for person in lab.people]

    lab.run(each_frame=note)
    assert not lab.incident
    for seat, person in enumerate(lab.people):
        assert person.core.coupling.down_margin_j + allowed("down_margin_j") >= -1e-12
        up = lab.room.seat_account(seat)
        assert up.up_margin_j + allowed("up_margin_j") >= -1e-12
        down = person.core.handle(CloseLedger(lab.ticks()), person.core.now_ns)
        for account in (up.playout, down.playout):
            assert account.most_frames >= account.depth_frames >= account.least_frames
    for direction, found in depths.items():
        ticks = line_delay(Playout(frames="auto"), link_of(name, direction), RATES).playout_ticks
        assert mean(found) == pytest.approx(ticks / RATES.ticks_per_frame, abs=1.0)


def test_without_jitter_auto_plays_what_no_playout_plays() -> None:
    """Bit by bit, where the link is a whole number of frames long."""
    forces = []
    for frames in (0, "auto"):
        table = {
            "seconds": 1.0,
            "link": {"delay_ms": 3e3 / 128},
            "playout": {"frames": frames},
            "users": [{"name": "anna"}, {"name": "ben"}],
        }
        felt: list[tuple[float, ...]] = []
        lab = Laboratory(resolve(table))
        lab.run(each_frame=lambda lab, felt=felt: felt.extend(tuple(person.core.force_n) for person in lab.people))
        forces.append(felt)
    assert forces[0] == forces[1]
    assert any(force[0] for force in forces[0])
