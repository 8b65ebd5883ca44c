"""The device port: the energy ledger and its controllers, by their equations, from both sides, and for any law and motion."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cogrip.client.hand.velocity import largest_impedance
from cogrip.client.inputs import DeviceOpened
from cogrip.client.safety.carried_impedance import BACKOFF_FACTOR, LEAST_FRACTION, RETRY_FRACTION
from cogrip.client.safety.device_port import (
    FADE_TICKS,
    FREE_RESERVE_MPS,
    INJECTED_FRACTION,
    TOLERATED_FRACTION,
    DevicePort,
)
from cogrip.client.safety.force_limits import SOFT_SLOPE_NPS
from cogrip.client.safety.oscillation import REVERSALS, TRAIN
from cogrip.client.safety.releases import MOST_RELEASES, RELEASED_S

from tests.client.seated_client import DEVICE_HZ, T_C, T_N, Client, M, at_ns, capability
from tests.kinds import schemes_of

RECORD = replace(capability(3, speed_mps=2.0), peak_force_n=8.0, slew_nps=500.0)
STEP_M = RECORD.speed_mps * T_C
FREE_J = 0.5 * 0.1 * FREE_RESERVE_MPS**2
STILL = (0.0,) * 3


def port(**record: float) -> DevicePort:
    made = DevicePort(replace(RECORD, **record), T_C)  # type: ignore[arg-type]
    made.ramped = False
    return made


@pytest.fixture
def tried() -> DevicePort:
    return port()


def test_the_reserve_is_a_brisk_hands_kinetic_energy_the_fading_and_a_fall_by_the_slope() -> None:
    """A force that falls from F by s newton a second gives out F^2 v_m / (2 s) at the most."""
    for slew_nps in (SOFT_SLOPE_NPS, 200.0):
        fall_j = 8.0**2 * 2.0 / (2.0 * slew_nps)
        assert port(slew_nps=slew_nps).reserve_j == pytest.approx(FREE_J + FADE_TICKS * 8.0 * STEP_M + fall_j)
    assert port().reserve_j == port(slew_nps=SOFT_SLOPE_NPS).reserve_j


rows = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(
    st.lists(st.tuples(rows, rows, st.floats(0.0, 0.05), st.floats(0.0, 1.0)), min_size=1, max_size=120),
    st.sampled_from([0.0, 0.5, 20.0]),
    st.sampled_from([0.0, 0.04]),
)
def test_no_more_leaves_through_the_motors_than_came_in_whatever_the_law_and_the_motion(
    ticks: list[tuple[tuple[float, ...], tuple[float, ...], float, float]], damping: float, friction: float
) -> None:
    """E >= -E_0 after every tick, for any force law, any motion within the speed limit, and a line that takes all it may.

    E is added up here once more, from the forces that were let through and the displacements, with all that damping took.
    """
    tried = port(own_damping_nspm=damping, own_friction_n=friction)
    slope_n = SOFT_SLOPE_NPS * T_C  # by which forces fall at least as fast, whatever else happens
    work = given_j = own = 0.0
    force: tuple[float, ...] = (0.0,) * 3
    x = start = (0.0,) * 3
    for number, (wish, motion, brought, share) in enumerate(ticks, 1):
        law = tried.limit([8.0 * part / max(1.0, hypot(*wish)) for part in wish])
        change = [new - old for new, old in zip(law, force, strict=True)]
        share = min(1.0, slope_n / max(slope_n, hypot(*change)))
        force = tuple([old + share * part for old, part in zip(force, change, strict=True)])
        length = max(1.0, hypot(*motion))
        step = [STEP_M * part / length for part in motion]
        work += sum(f * d for f, d in zip(force, step, strict=True))
        own += hypot(*step) * (damping * hypot(*step) / T_C + friction)
        x = tuple(at + d for at, d in zip(x, step, strict=True))
        tried.set_energies(work, given_j)
        if number % M == 0:
            spare = tried.spare_j + brought
            given_j += brought - share * max(0.0, spare)
            tried.end_frame(start, x, T_N, 0.0)
            tried.set_energies(work, given_j)
            start = x
        assert tried.balance_j >= -tried.reserve_j - 1e-12
        assert work + given_j + own >= -tried.reserve_j - 1e-12
    assert tried.account().margin_j == pytest.approx(tried.least_j + tried.reserve_j)


@given(st.floats(-1.0, 0.5), st.just(0.0) | st.floats(0.1, 50.0))
def test_the_bound_on_a_force_is_what_a_tick_may_give_out(balance: float, damping: float) -> None:
    """|F| 3 v_m T = E + E_1, or F^2 T / (4 b_d) = E + E_1 (theory 7.4), the larger; not a hair less is let through."""
    tried = port(own_damping_nspm=damping)
    tried.balance_j = balance * tried.reserve_j
    left = max(0.0, tried.balance_j + FREE_J + FADE_TICKS * 8.0 * STEP_M)
    most = max(left / (FADE_TICKS * STEP_M), 2.0 * sqrt(damping * left / T_C))
    assert tuple(tried.limit((0.999 * most, 0.0, 0.0))) == (0.999 * most, 0.0, 0.0)
    assert hypot(*tried.limit((0.6 * 1.001 * most, 0.8 * 1.001 * most, 0.0))) == pytest.approx(most)
    assert tuple(tried.limit(STILL)) == STILL


def test_the_devices_damping_is_credited_with_the_motion_of_a_frame_less_one_count() -> None:
    count = 3e-5
    tried = port(own_damping_nspm=2.0, own_friction_n=0.1, resolution_m=count)
    tried.end_frame(STILL, (0.003, 0.004, 0.0), T_N, 0.0)
    path = 0.005 - count
    assert tried.balance_j == pytest.approx(2.0 * path * path / T_N + 0.1 * path)
    before = tried.balance_j
    tried.end_frame(STILL, (count, 0.0, 0.0), T_N, 0.0)
    assert tried.balance_j == before, "a count that flickers is no motion"


def test_energy_of_long_ago_pays_for_nothing(tried: DevicePort) -> None:
    tried.set_energies(5.0, 0.0)
    tried.end_frame(STILL, STILL, T_N, 0.3)
    assert tried.balance_j == pytest.approx(0.3 + tried.reserve_j)
    tried.set_energies(4.0, 0.0)
    assert tried.balance_j == pytest.approx(0.3 + tried.reserve_j - 1.0)


def test_what_a_ramped_force_leaves_to_the_line_is_not_asked_back(tried: DevicePort) -> None:
    """But what the motors gave is."""
    tried.ramped = True
    tried.set_energies(-0.01, -0.5)
    assert tried.balance_j == pytest.approx(-0.01)
    assert tried.earned_j == pytest.approx(-0.51)
    assert tried.spare_j == pytest.approx(tried.earned_j + 0.05), "it may be sent no more: half the mass, at 1 m/s"
    tried.ramped = False
    assert tried.spare_j == pytest.approx(tried.balance_j + 0.05)
    for work_j, tried.ramped in ((-0.03, False), (-0.04, True)):
        tried.set_energies(work_j, -0.5)
        assert tried.balance_j == pytest.approx(work_j)


def test_what_a_frame_would_send_counts_as_far_as_it_may_be_sent(tried: DevicePort) -> None:
    for brought, pending, balance in (
        (0.3, 0.1, 0.2),
        (0.3, 0.3 + FREE_J, -FREE_J),
        (0.3, 20.0, -FREE_J),
        (-FREE_J - 0.1, 20.0, -FREE_J - 0.1),
    ):
        tried.set_energies(0.0, brought, pending)
        assert tried.balance_j == pytest.approx(balance)
        assert tried.spare_j == pytest.approx(max(brought, balance) + FREE_J), "whatever the ticks so far would send"
    assert tried.least_j == pytest.approx(-FREE_J - 0.1)


def test_no_more_is_forgiven_to_a_line_than_the_free_reserve(tried: DevicePort) -> None:
    """Frame by frame the line takes all that it may, while the force is ramped in and out."""
    for number in range(200):
        tried.ramped = number // 20 % 2 == 0
        tried.set_energies(0.0, 0.001 * number, 20.0)
        tried.end_frame(STILL, STILL, T_N, 0.0)
        assert tried.balance_j - tried.earned_j <= FREE_J + 1e-12
        assert tried.earned_j >= -2.0 * FREE_J - 1e-12


def test_a_damper_pays_for_what_is_lent_for_long(tried: DevicePort) -> None:
    half = 0.5 + 0.5 * TOLERATED_FRACTION
    for share, paying in ((0.0, 0.0), (TOLERATED_FRACTION, 0.0), (half, 0.5), (1.0, 1.0), (2.0, 1.0)):
        tried.balance_j = -share * FREE_J
        assert tried.injected_nspm == pytest.approx(paying * INJECTED_FRACTION * tried.carried.nspm)


def test_an_overdrawn_port_says_so_and_begins_anew(tried: DevicePort) -> None:
    tried.set_energies(-50.0, 0.0)
    found = [tried.watch(STILL, False, STILL) for _ in range(DEVICE_HZ)]
    assert found.index("energy") == round(RELEASED_S * DEVICE_HZ)
    assert tried.balance_j == 0.0
    assert tried.account().margin_j == pytest.approx(tried.reserve_j - 50.0), "the verdict does not forget it"


def test_the_reserve_of_now_begins_anew_with_the_port_and_its_least_does_not(tried: DevicePort) -> None:
    """A debt that was forgiven is in the margin for good; what the port may still give is its whole reserve again."""

    def second(work_j: float) -> None:
        for tick in range(DEVICE_HZ + 8):
            tried.elapse()
            tried.set_energies(work_j, 0.0)
            if tick % 8 == 7:
                tried.end_frame(STILL, STILL, 8 / DEVICE_HZ, 0.0)

    tried.set_energies(-0.02, 0.0)
    assert tried.account().reserve_j is None
    second(-0.01)
    assert tried.account().reserve_j == pytest.approx(tried.reserve_j - 0.01)
    assert tried.account().margin_j == pytest.approx(tried.reserve_j - 0.02)
    second(-50.0)
    tried.rearm()
    second(-50.0)
    assert tried.balance_j == 0.0
    assert tried.account().reserve_j == tried.account().margin_j == pytest.approx(tried.reserve_j - 50.0)


def _shake(tried: DevicePort, turns: int, force_n: float = 2.0, half_ticks: int = 8) -> str:
    """A square wave of the local force alone, riding on 5 N, until it is found."""
    for number in range(turns * half_ticks):
        local = force_n if number // half_ticks % 2 else -force_n
        tried.elapse()
        if found := tried.watch([5.0 + local, 0.0, 0.0], False, [local, 0.0, 0.0]):
            return found
    return ""


def test_the_impedance_comes_down_with_a_train_of_turns_and_is_tried_again_below(tried: DevicePort) -> None:
    carried = largest_impedance(RECORD, T_C).impedance_nspm
    assert tried.carried.nspm == carried
    _shake(tried, TRAIN)
    assert tried.carried.nspm == carried, "an impact is no train"
    _shake(tried, TRAIN + 3)
    assert LEAST_FRACTION * carried < tried.carried.nspm < carried * BACKOFF_FACTOR * 1.05
    for _ in range(10 * DEVICE_HZ):
        tried.watch(STILL, False, STILL)
    again = tried.carried.nspm / carried
    assert BACKOFF_FACTOR < again < RETRY_FRACTION * 1.3, "below what the train began at"
    for _ in range(60):
        _shake(tried, 10)
    assert tried.carried.nspm == pytest.approx(LEAST_FRACTION * carried, rel=0.05)


@pytest.mark.parametrize("absorbs", [False, True])
def test_a_line_that_rings_takes_impedance_where_that_absorbs_what_returns(absorbs: bool) -> None:
    """The whole force reverses at each frame, the local one does not: from the fifth fast reversal in a row on."""
    tried = DevicePort(RECORD, T_C, M)
    carried = tried.carried.nspm
    for frame in range(REVERSALS + 3):
        force = (0.4 if frame % 2 else -0.4, 0.0, 0.0)
        for _ in range(M):
            tried.elapse()
            assert tried.watch(force, False, STILL, absorbs=absorbs) == ""
        backed_off = absorbs and frame >= REVERSALS
        assert (tried.carried.nspm < 0.6 * carried) is backed_off, frame
    assert not tried.oscillates


def test_a_shaken_hand_is_seen_however_little_is_rendered(tried: DevicePort) -> None:
    """The same motion at the impedance that is left makes a tenth of the force."""
    tried.carried.nspm *= 0.1
    assert _shake(tried, 30, force_n=0.2) == "oscillation"
    assert _shake(port(), 30, force_n=0.2) == ""


def test_oscillation_lets_go_and_is_a_fault_where_it_persists(tried: DevicePort) -> None:
    for _ in range(MOST_RELEASES + 1):
        assert not tried.releases.persists
        assert _shake(tried, 30) == "oscillation"
        assert tried.releases.releasing
        for _ in range(round(RELEASED_S * DEVICE_HZ)):
            tried.elapse()
        assert not tried.releases.releasing
    assert tried.releases.persists
    assert tried.account().oscillates
    tried.rearm()
    assert not tried.releases.persists


kinds = st.sampled_from(schemes_of("cube"))


@given(kinds, st.integers(1, 3), st.integers(0, 2**32 - 1), st.floats(0.0, 1.9), st.floats(0.0, 30.0))
def test_the_port_of_a_whole_client_is_passive(kind: str, axes: int, seed: int, speed: float, wave: float) -> None:
    """The port is passive for any waves, any motion, and velocities that are not the hand's."""
    client = Client(axes, speed_mps=2.0, bare=False, kind=kind, impedance_nspm=60.0)
    random, core = np.random.default_rng(seed), client.core
    place, motion = np.zeros(axes), np.zeros(axes)
    for number in range(700):
        if random.random() < 0.05:
            motion = random.uniform(-1.0, 1.0, axes)
            motion *= speed / max(1.0, float(np.linalg.norm(motion)))
        place = np.clip(place + motion * T_C, -0.9, 0.9)
        if kind == "wave" and number % M == 0 and number:
            client.hear(at_ns(number), *random.uniform(-wave, wave, axes).tolist())
        client.tick(number, *place.tolist(), velocity=random.uniform(-1.0, 1.0, axes).tolist())
        assert core.port.balance_j >= -core.port.reserve_j - 1e-12
    margin_j = client.account().device.margin_j
    assert margin_j is not None
    assert margin_j >= -1e-12


def test_what_a_line_is_sent_is_not_cut_off_of_the_balance_as_well() -> None:
    """A line whose energy is absorbed, then spent on what was withheld: the balance has it once."""
    client = Client(bare=False, speed_mps=1.0)
    seated = client.seated
    client.core.handle(DeviceOpened(seated.capability), 0)
    seated.safety.fail("of the test")
    client.hear(0, 30.0)
    client.run(range(32 * M), wave=30.0)
    client.hear(at_ns(32 * M), 30.0)
    client.waves.up.withhold((1e6,), anew=True)
    client.tick(32 * M, 0.0)
    client.run(range(32 * M + 1, 64 * M), wave=0.0)
    free_j = 0.5 * seated.capability.apparent_mass_kg
    assert seated.port.least_j == pytest.approx(-free_j), "all that was there to be spent, and no more"
    assert seated.port.account().margin_j > 0.0
