"""A hand that touches nothing does not ring, whoever holds the device, over any delay."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.analysis.advice.free_end import free_end
from cogrip.analysis.feel.feel import no_contact
from cogrip.analysis.linear.lifted_model import LiftedModel
from cogrip.analysis.linear.linear_session import LinearSession, seat_session
from cogrip.analysis.linear.stability import verdict
from cogrip.client.hand.velocity import largest_impedance
from cogrip.devices.device import Capability
from cogrip.devices.registry import make
from cogrip.protocol.settings.room import resolve, seat_settings

from tests.sim.session_measures import summary_of

T_C = 1.0 / 1024
PHANTOM = make("sim:phantom").capability
MODELS = (
    "sim:phantom", "forcedimension:0?model=falcon", "forcedimension:0?model=omega3", "openhaptics:x?model=touch",
    "openhaptics:x?model=premium1.0", "emulated:vintage", "emulated:woodenhaptics", "emulated:default-woody", "emulated:polhem",
    "emulated:aluhaptics", "emulated:2diy", "emulated:pantograph", "emulated:inverse3",
)  # fmt: skip


def held(
    record: Capability, b: float, delay_ms: float, stiffness: float, damping: float, known: float
) -> LinearSession:
    """Return the model of a hand in free air."""
    table = {"link": {"delay_ms": delay_ms}, "coupling": {"impedance_nspm": b}, "users": [{"name": "a"}]}
    found = no_contact(seat_session(seat_settings(resolve(table), 0), record), 0)
    changes = {"hand_stiffness_npm": stiffness, "hand_damping_nspm": damping, "mass_known": known}
    return replace(found, people=(replace(found.people[0], **changes),))


RECORDS = st.builds(
    lambda mass, age: replace(PHANTOM, apparent_mass_kg=mass, latency_ticks=age, damping_nspm=1e3, resolution_m=0.0),
    st.floats(0.02, 0.3),
    st.integers(0, 2),
)
DELAYS = st.floats(0.0, 40.0) | st.floats(0.0, 300.0)


@given(
    RECORDS,
    st.floats(0.05, 1.0),
    DELAYS,
    st.sampled_from([(60.0, 1.0), (300.0, 5.0), (1000.0, 10.0)]),
    st.floats(0.67, 1.33),
)
@settings(deadline=None)
def test_nothing_grows_in_a_hand_within_what_a_device_carries_though_its_mass_is_wrong_by_a_third(
    record: Capability, share: float, delay_ms: float, grip: tuple[float, float], known: float
) -> None:
    b = share * largest_impedance(record, T_C).impedance_nspm
    assert verdict(LiftedModel(held(record, b, delay_ms, *grip, known))).stable


@given(RECORDS, st.floats(0.05, 1.0), DELAYS, st.floats(1.0, 1.33))
@settings(deadline=None)
def test_nothing_grows_where_nobody_holds_the_device(
    record: Capability, share: float, delay_ms: float, known: float
) -> None:
    b = share * largest_impedance(record, T_C).impedance_nspm
    assert verdict(LiftedModel(held(record, b, delay_ms, 0.0, 0.0, known))).stable


@pytest.mark.parametrize("address", MODELS)
def test_every_device_record_is_quiet_at_what_it_carries(address: str) -> None:
    record = make(address).capability
    b = min(20.0, largest_impedance(record, T_C).impedance_nspm)
    for delay_ms in (0.0, 1.0, 2.9, 5.0, 10.0, 20.0, 50.0, 150.0, 300.0):
        table = {"link": {"delay_ms": delay_ms}, "coupling": {"impedance_nspm": b}, "users": [{"name": "a"}]}
        found = free_end(seat_session(seat_settings(resolve(table), 0), record), 0)
        assert found is not None
        assert found.growing == (), delay_ms


def test_positions_alone_ring_and_the_number_that_would_do_is_named() -> None:
    """A device of 75 g at b = 20 grows on positions alone; at the number that is named nothing does."""
    table = {"link": {"delay_ms": 5.0}, "coupling": {"impedance_nspm": 20.0}, "users": [{"name": "a"}]}
    session = seat_session(seat_settings(resolve(table), 0), PHANTOM)
    blind = replace(session, people=(replace(session.people[0], mass_known=float("inf")),))
    found = free_end(blind, 0)
    assert found is not None
    assert "with nobody holding it" in [grip.name for grip in found.growing]
    quiet = replace(blind, people=(replace(blind.people[0], impedance_nspm=found.quiet_nspm),))
    again = free_end(quiet, 0)
    assert again is not None
    assert set(found.growing).isdisjoint(again.growing)


@pytest.mark.sample(5)
@pytest.mark.parametrize(
    "grip", ["hand_stiffness_npm=60&hand_damping_nspm=1", "hand_stiffness_npm=300&hand_damping_nspm=5"]
)
@pytest.mark.parametrize("delay_ms", [0.0, 5.0, 20.0, 80.0, 300.0])
def test_a_free_hand_is_left_alone_by_the_device_port(grip: str, delay_ms: float) -> None:
    """Counts, friction and the actual cores; the motion stays clear of wall and stops."""
    hand = f"reach&amplitude_m=-0.02&stroke_s=0.6&{grip}"
    users = [{"name": "a", "device": "sim:phantom?x0_m=-0.04&mass_kg=0.075", "hand": hand, "device_mass_kg": 0.075}]
    summary = summary_of(seconds=4.0, object={"kind": "wall"}, link={"delay_ms": delay_ms}, users=users)
    (user,) = summary["users"]
    assert (user["let_go"], user["oscillates"], user["state"]) == (0, False, "live")
    assert user["controlled"] < 0.01
    assert user["shake_n"] < 0.175, "counts of 0.03 mm and steps at each frame are left"


@pytest.mark.parametrize("delay_ms", [2.0, 10.0, 60.0, 300.0])
def test_a_device_that_nobody_holds_comes_to_rest_and_stays(delay_ms: float) -> None:
    hand = "push&force_n=0"
    users = [{"name": "a", "device": "sim:phantom?x0_m=-0.04&mass_kg=0.075", "hand": hand, "device_mass_kg": 0.075}]
    summary = summary_of(seconds=4.0, object={"kind": "wall"}, link={"delay_ms": delay_ms}, users=users)
    (user,) = summary["users"]
    assert user["peak_force_n"] < 0.01
    assert user["let_go"] == 0
