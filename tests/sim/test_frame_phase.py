"""Frames at their own ticks, in whole sessions: the loop is the link's own delay in ticks and one frame, and stays passive."""

from itertools import pairwise, product
from typing import Any

import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from cogrip.protocol.laws.felt_stiffness import felt_stiffness, line_compliance
from cogrip.protocol.settings.delays import line_delay
from cogrip.protocol.settings.room import seat_settings
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.sim.session_measures import account_of, by_frame, laboratory_of

PRESS = "reach&amplitude_m=0.008&stroke_s=0.5&delay_s=0.5&stop_s=1.0"
TICK_S = 1.0 / 1024.0
CREDIT_J = 1e-3 + 1e-12
NETWORKS = ("lan", "wifi", "wan", "lte", "satellite")


def session(link: dict[str, Any], seconds: float = 3.0, seed: int = 1, people: int = 1, **tables: Any) -> Laboratory:
    users = [{"name": f"u{n}", "device": f"sim:phantom?hand={PRESS}"} for n in range(people)]
    thing, coupling = {"kind": "wall" if people == 1 else "cube"}, {"stiffness_npm": 1000.0}
    return laboratory_of(seed=seed, seconds=seconds, object=thing, link=link, coupling=coupling, users=users, **tables)


def ended(laboratory: Laboratory) -> None:
    """Close all ledgers, and check that no line has made energy beyond its credit."""
    for number, seat in enumerate(laboratory.room.seats):
        assert account_of(laboratory, number).down_margin_j >= -CREDIT_J
        assert seat.port.up_margin_j >= -CREDIT_J
        assert seat.line_margin_j >= -2.0 * CREDIT_J


def phases_of(laboratory: Laboratory) -> list[int]:
    """Run a session to its end; return the phase of the first person's frames, frame by frame."""
    return by_frame(laboratory, lambda now: now.people[0].core.coupling.up.phase)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("delay_ms", "ticks"), [(0.0, 0), (0.1, 1), (7.8125, 8), (20.0, 21)])
def test_a_frame_meets_the_step_and_its_answer_is_played_at_once(delay_ms: float, ticks: int) -> None:
    laboratory = session({"delay_ms": delay_ms})
    phases = phases_of(laboratory)
    core = laboratory.people[0].core
    assert core.coupling.loop_frames() == (2 * ticks + 8) / 8
    assert core.coupling.playout_frames == 0.0
    assert len(set(phases[64:])) == 1, "shifted once, and left alone"
    assert (phases[-1] + ticks) % 8 == 0, "it is sent so many ticks before a step"
    compliance = line_compliance(20.0, 2 * ticks * TICK_S, 1.0 / 128.0)
    felt = core.force_n[0] / core.position_m[0]
    assert felt == pytest.approx(felt_stiffness(1000.0, compliance), rel=1e-3)
    ended(laboratory)


microseconds = st.integers(0, 60_000).map(lambda us: us * 1e-3)  # in ms


@pytest.mark.long
@given(microseconds, microseconds, st.sampled_from((512, 1024, 2048)))
@settings(max_examples=8, deadline=None, phases=(Phase.explicit, Phase.generate))
@example(1e-3, 7.813, 1024)
def test_on_any_constant_link_the_loop_is_the_one_that_is_expected(up_ms: float, down_ms: float, hz: int) -> None:
    laboratory = session({"up": {"delay_ms": up_ms}, "down": {"delay_ms": down_ms}}, 1.0, rates={"device_hz": hz})
    laboratory.run()
    seat = seat_settings(laboratory.settings, 0)
    frames = sum(line_delay(seat.playout, way, seat.rates).frames for way in (seat.up, seat.down))
    assert laboratory.people[0].core.coupling.loop_frames() == pytest.approx(frames + 1.0, abs=1e-9)
    ended(laboratory)


@pytest.mark.sample(1)
@pytest.mark.parametrize(("network", "seed"), every(42, product(NETWORKS, range(1, 21))))
def test_it_stays_passive_on_every_network(network: str, seed: int) -> None:
    laboratory = session({"profile": network}, 3.0, seed, (2, 3, 5)[seed % 3])
    laboratory.run()
    assert not laboratory.incident
    ended(laboratory)


@pytest.mark.long
@pytest.mark.parametrize("network", every(2, ["wifi", "lte"]))
def test_the_phase_shifts_rarely(network: str) -> None:
    settled = phases_of(session({"profile": network}, 14.0))[6 * 128 :]
    assert sum(one != other for one, other in pairwise(settled)) <= 16, "twice a second"
    assert all(abs(other - one) <= 1 for one, other in pairwise(settled))


def test_a_number_of_frames_keeps_common_borders() -> None:
    laboratory = session({"delay_ms": 3.0}, playout={"frames": 1})
    laboratory.run()
    coupling = laboratory.people[0].core.coupling
    assert (coupling.up.phase, coupling.loop_frames()) == (0, 5.0)
    ended(laboratory)
