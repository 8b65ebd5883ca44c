"""Seat limits: a player brings in at most what a device with its record could."""

from math import hypot, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.protocol.laws.waves import wave_of
from cogrip.protocol.settings.room import for_remote_clients, resolve
from cogrip.protocol.settings.sections import REMOTE_FORCE_N, REMOTE_SPEED_MPS, Settings
from cogrip.protocol.settings.types import HUMAN_POWER_W
from cogrip.protocol.wire.messages import NO_BOUND, Stamp, State
from cogrip.server.ports.seat_limits import (
    BURST_S,
    MOST_S,
    ClaimedRecord,
    SeatLimits,
    StateLimiter,
    WaveLimiter,
    limits_of,
    misclaimed,
)
from cogrip.server.room import Room
from cogrip.server.seats.observers import VIEWS_HZ

FRAME_S = 1 / 128
PHANTOM = ClaimedRecord("sim:phantom?hand=reach", 3, 1024.0, 8.5, 2.0)
wave = st.floats(-50.0, 50.0)


def settings(**admission: object) -> Settings:
    return resolve(
        {"users": [{"name": "anna", "device": "sim:phantom"}, {"name": "ben", "power_w": 3.0}], "admission": admission}
    )


def limiter(b: float = 20.0, **limits: float) -> WaveLimiter:
    return WaveLimiter(b, FRAME_S, SeatLimits(**limits))


def test_the_largest_wave_of_a_device_passes_and_nothing_beyond() -> None:
    """(b V + F) / sqrt(2b): the velocity limit and the peak force at once."""
    bound = limiter(force_n=8.5, speed_mps=2.0)
    largest = (20.0 * 2.0 + 8.5) / sqrt(40.0)
    assert bound.limit((largest * (1.0 - 1e-12),)) == (largest * (1.0 - 1e-12),)
    assert not bound.counts
    (clipped,) = bound.limit((-largest * 1.01,))
    assert clipped == pytest.approx(-largest, rel=1e-12)
    assert bound.counts == {"wave clipped": 1}
    assert bound.taken_j == pytest.approx((1.01**2 - 1.0) * largest**2 * FRAME_S / 2)


@pytest.mark.parametrize(("torque_nm", "speed_radps", "further"), [(8.5, 2.0, 8.0), (0.2, 20.0, 0.02)])
def test_a_gripper_or_turning_is_limited_together_with_the_places(
    torque_nm: float, speed_radps: float, further: float
) -> None:
    """By force and speed of the claimed record at both impedances; one that is cut keeps its direction."""
    bound = WaveLimiter(20.0, FRAME_S, SeatLimits(8.5, 2.0, 1e6, torque_nm, speed_radps), 1.0, further)
    for share in (1.0, 2.0):
        bound.set_impedance(20.0 * share)
        u = bound.limit((0.0, 100.0, 0.0, 100.0))
        most = wave_of(20.0 * share, 2.0, 8.5) ** 2 + wave_of(further * share, speed_radps, torque_nm) ** 2
        assert hypot(*u) ** 2 == pytest.approx(most)
        assert u[1] == u[3]
    assert bound.counts == {"wave clipped": 2}


@given(st.lists(st.tuples(wave, wave, wave), min_size=1, max_size=30))
def test_a_clipped_wave_keeps_its_direction_and_never_grows(waves: list[tuple[float, ...]]) -> None:
    bound = limiter(force_n=3.0, speed_mps=0.5)
    largest = (20.0 * 0.5 + 3.0) / sqrt(40.0)
    for sent in waves:
        out = bound.limit(sent)
        assert hypot(*out) <= min(hypot(*sent), largest) * (1 + 1e-12)
        for a, b in zip(out, sent, strict=True):
            assert a * hypot(*sent) == pytest.approx(b * hypot(*out), abs=1e-9)
        bound.book((0.0, 0.0, 0.0))


@given(st.lists(st.tuples(wave, st.floats(0.0, 1.0)), min_size=1, max_size=200), st.floats(0.1, 50.0))
def test_no_player_brings_in_more_power_than_the_limit(steps: list[tuple[float, float]], power_w: float) -> None:
    """Against any player and any world that gives back a part of what comes: power * (time + BURST_S) and one returned wave."""
    bound = limiter(power_w=power_w)
    brought_j = largest_j = 0.0
    for number, (sent, share) in enumerate(steps, start=1):
        (u,) = bound.limit((sent,))
        v = share * u
        bound.book((v,))
        brought_j += (u * u - v * v) * FRAME_S / 2
        assert brought_j <= power_w * (number * FRAME_S + BURST_S) + largest_j + 1e-9
        largest_j = max(largest_j, v * v * FRAME_S / 2)


@given(st.floats(0.0, 100.0), st.floats(0.01, 5.0))
def test_a_hand_that_holds_still_is_never_limited(force_n: float, power_w: float) -> None:
    """A hand at rest: u = F / sqrt(2b) comes and v = -u goes, whatever the force."""
    bound = limiter(power_w=power_w)
    u = force_n / sqrt(40.0)
    level = 0.0
    for _ in range(300):  # pressed up slowly, as a hand would, then held
        level = min(u, level + u / 150)
        bound.book((-level,))
        bound.limit((level,))
    bound.book((-u,))
    before = dict(bound.counts)
    for _ in range(100):
        assert bound.limit((u,)) == (u,)
        bound.book((-u,))
    assert bound.counts == before


def test_without_bounds_nothing_is_touched() -> None:
    bound = limiter()
    for value in (0.0, 1e4, -1e4):
        assert bound.limit((value,)) == (value,)
        bound.book((0.0,))
    assert not bound.counts
    assert bound.taken_j == 0.0


def test_limits_come_from_the_record_and_the_settings() -> None:
    assert limits_of(PHANTOM, settings(), 0) == SeatLimits(8.5, 2.0, HUMAN_POWER_W)
    assert limits_of(PHANTOM, settings(power_w=0.0), 0) == SeatLimits(8.5, 2.0, 17.0), "0: the device's own"
    assert limits_of(PHANTOM, settings(power_w=5.0), 0) == SeatLimits(8.5, 2.0, 5.0)
    assert limits_of(PHANTOM, settings(power_w=5.0), 1) == SeatLimits(8.5, 2.0, 3.0)
    ideal = ClaimedRecord("sim:ideal", 1, 1e4, NO_BOUND, NO_BOUND)
    bounded = SeatLimits(REMOTE_FORCE_N, REMOTE_SPEED_MPS, HUMAN_POWER_W)
    assert limits_of(ideal, for_remote_clients(settings()), 0) == bounded
    assert limits_of(ideal, settings(), 0) == bounded, "on this machine, too"
    own = limits_of(ideal, for_remote_clients(settings(force_n=7.0, speed_mps=2.0, power_w=0.0)), 0)
    assert own == SeatLimits(7.0, 2.0, 14.0)
    assert limits_of(PHANTOM, for_remote_clients(settings()), 0) == SeatLimits(8.5, 2.0, HUMAN_POWER_W)
    assert limits_of(ideal, settings(), 1).power_w == 3.0


@pytest.mark.parametrize(
    ("admission", "record", "words"),
    [
        ({"force_n": 8.5}, PHANTOM, ""),
        ({"force_n": 8.4}, PHANTOM, "claims 8.5 N, more than admission.force_n = 8.4"),
        ({"speed_mps": 1.9}, PHANTOM, "claims 2 m/s, more than admission.speed_mps = 1.9"),
        ({"force_n": 1.0, "speed_mps": 0.1}, ClaimedRecord("sim:ideal", 1, 1e4, NO_BOUND, NO_BOUND), ""),
        ({"devices": "listed"}, PHANTOM, ""),
        (
            {"devices": "listed"},
            ClaimedRecord("hid:woodenhaptics", 3, 1e3, 8.5, 2.0),
            "the seat of 'anna' is for sim:phantom",
        ),
    ],
)
def test_a_claim_is_judged_by_the_settings(admission: dict[str, object], record: ClaimedRecord, words: str) -> None:
    said = misclaimed(record, settings(**admission), 0)
    assert (words in said) if words else not said


def state(number: int, place: float, speed: float = 0.0) -> State:
    return State(1, number, (place,), (speed,), 0.0, 0, Stamp(1))


def believes(bound: StateLimiter, told: State) -> bool:
    """Judge a state as a port does, whose receiver accepts it."""
    fits = bound.fits(told)
    if fits:
        bound.took(told)
    return fits


def test_numbers_that_run_ahead_of_the_servers_steps_give_no_further_reach() -> None:
    """Ten states a step, numbered 256 apart: on the whole no faster than the record says, after the first two seconds."""
    bound = StateLimiter(FRAME_S, SeatLimits(speed_mps=1.28))
    place, number = 0.0, 0
    assert believes(bound, state(0, 0.0))
    for _ in range(1280):
        for _ in range(10):
            number += 256
            further = place + 0.01 * 0.999
            if believes(bound, state(number, further)):
                place = further
        bound.step(1)
    assert place <= 0.01 * (1280 * 1.01 + round(MOST_S / FRAME_S))
    assert bound.counts["state out of bounds"] > 0


def test_a_state_that_is_not_received_does_not_move_the_bound() -> None:
    bound = StateLimiter(FRAME_S, SeatLimits(speed_mps=1.28))
    assert believes(bound, state(0, 0.0))
    assert bound.fits(state(2**53, 0.009))  # too far ahead for a receiver
    assert not bound.fits(state(1, 0.011))
    assert believes(bound, state(1, 0.009))


def test_states_of_a_coupled_hand_are_judged_by_its_speed() -> None:
    bound = StateLimiter(FRAME_S, SeatLimits(speed_mps=1.28))  # 10 mm a frame
    assert believes(bound, state(0, 0.3, 1.28))
    assert believes(bound, state(1, 0.3099))
    assert not believes(bound, state(2, 0.32001 + 1e-9))
    assert believes(bound, state(3, 0.3298))  # two frames after the last that was believed
    assert not believes(bound, state(4, 0.3298, -1.281))
    assert believes(bound, state(2, 9.0))  # too late to be applied, so not judged by its place
    assert bound.counts == {"state out of bounds": 2}
    assert StateLimiter(FRAME_S, SeatLimits()).fits(state(0, 1e3, 1e4))


@pytest.mark.parametrize("network_hz", [32, 128, 1024])
def test_how_far_a_hand_may_have_gone_in_silence_is_the_same_at_every_rate(network_hz: int) -> None:
    """Two seconds at its speed, however many frames that are."""
    for metres, fits in ((MOST_S * 1.28, True), (MOST_S * 1.28 * 1.001, False)):
        bound = StateLimiter(1.0 / network_hz, SeatLimits(speed_mps=1.28))
        assert believes(bound, state(0, 0.0, 0.0))
        assert believes(bound, state(10 * network_hz, metres, 0.0)) is fits


@pytest.mark.parametrize(
    ("network_hz", "views"), [(32, 32), (48, 48), (64, 64), (100, 50), (128, 64), (1000, 62), (1024, 64)]
)
def test_views_are_no_more_than_a_picture_needs_at_any_rate(network_hz: int, views: int) -> None:
    room = Room(resolve({"rates": {"device_hz": 8 * network_hz, "network_hz": network_hz}}))
    room.observer_slots.enter(1, 1, 0)
    sent = sum(len(room.observer_slots.views(step, room.world, [], 0)) for step in range(1, network_hz + 1))
    assert sent == views <= VIEWS_HZ


@pytest.mark.parametrize(("speed_mps", "limited"), [(1.0, False), (1.24, False), (1.26, True)])
def test_a_hand_that_pulls_with_eight_newtons_is_let_to_by_default(speed_mps: float, limited: bool) -> None:
    """For 10 s, against an object that takes all of it: F v = 8 W at 1 m/s, 10 W at 1.25 m/s."""
    root = sqrt(40.0)
    forward, back = (20.0 * speed_mps + 8.0) / root, (20.0 * speed_mps - 8.0) / root
    assert 0.5 * (forward**2 - back**2) == pytest.approx(8.0 * speed_mps)
    bound = WaveLimiter(20.0, FRAME_S, limits_of(PHANTOM, resolve({}), 0))
    for _ in range(round(60.0 / FRAME_S)):
        (u,) = bound.limit((forward,))
        bound.book((u * back / forward,))
    assert (bound.counts.get("power limited", 0) > 0) is limited
    assert "wave clipped" not in bound.counts
