"""Tests of whole sessions under time-domain passivity control: what it guarantees, and what not."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cogrip.analysis.linear.linear_session import ModelError, linear_session
from cogrip.protocol.laws.passivity_control import LENT_J
from cogrip.protocol.settings.coupling_kinds import UNLENT_MJ
from cogrip.protocol.settings.room import SettingsError, resolve, seat_settings
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.extent import every
from tests.sim.session_measures import FRAME_MS, run_frames

CONTROLLED = {"coupling": {"kind": "tdpa"}}
TWO = [
    {"name": "anna", "hand": "reach&amplitude_m=0.04"},
    {"name": "ben", "hand": "reach&amplitude_m=0.03&delay_s=0.25"},
]


def session(seconds: float, users: list[dict[str, Any]] = TWO, *, bare: bool = False, **overrides: Any) -> Laboratory:
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    laboratory = Laboratory(resolve({**CONTROLLED, "users": users, "seconds": seconds}, keys), bare=bare)
    laboratory.run()
    return laboratory


def margins(summary: dict[str, Any], key: str) -> list[float]:
    return [user["energy"][key] for user in summary["users"]]


@pytest.mark.parametrize(
    ("frames", "stiffness"), every(4, [(0, 4000.0), (1, 2000.0), (2, 2000.0), (4, 2000.0), (4, 10000.0)])
)
def test_it_holds_where_virtual_coupling_does_not(frames: int, stiffness: float) -> None:
    """Run rows of theory section 6's table in which virtual coupling has an eigenvalue outside the unit circle."""
    bad: dict[str, Any] = {"coupling__stiffness_npm": stiffness, "link__delay_ms": frames * FRAME_MS}
    held, loose = session(1.5, **bad), session(1.5, **bad, coupling__kind="coupling", bare=True)
    ours, theirs = of_laboratory(held), of_laboratory(loose)
    assert not any(ours[key] for key in ("unstable", "saturated", "left"))
    assert ours["object"]["travel_m"] < 0.15
    assert theirs["unstable"] or theirs["left"] or theirs["object"]["travel_m"] > 0.5
    assert min(margins(ours, "up_margin_j")) >= -LENT_J - 1e-12
    assert min(margins(theirs, "line_margin_j")) < -0.1
    assert ours["server"]["energy_balance_error_j"] < 1e-12
    assert max(abs(user["energy"]["device_leak_j"]) for user in ours["users"]) < 1e-12


@pytest.mark.long
def test_without_delay_it_is_a_virtual_coupling_and_follows_the_hand() -> None:
    ours, theirs = of_laboratory(session(3.0)), of_laboratory(session(3.0, coupling__kind="coupling"))
    assert ours["passive"]
    assert ours["object"]["travel_m"] == pytest.approx(theirs["object"]["travel_m"], rel=0.05)
    for mine, other in zip(ours["users"], theirs["users"], strict=True):
        assert mine["peak_force_n"] == pytest.approx(other["peak_force_n"], rel=0.25)
        assert mine["proxy_m"] == pytest.approx(mine["position_m"], abs=2e-3)
        assert mine["predicted_stiffness_npm"] is None


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(["cube", "cube", "faces"]), st.integers(1, 3), st.integers(2, 5), st.floats(0.0, 40.0),
    st.floats(0.0, 50.0), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(0.0, 0.5), st.floats(100.0, 1e5),
    st.integers(0, 2**53),
)  # fmt: skip
def test_under_any_network_conditions_no_object_gets_more_than_was_sent(
    thing: str, axes: int, people: int, delay_ms: float, jitter_ms: float, loss: float, duplicate: float, reorder: float,
    stiffness: float, seed: int,
) -> None:  # fmt: skip
    users = [
        {"name": f"u{number}", "side": ("left", "right")[number % 2], "hand": ("reach", "tremor", "push")[number % 3]}
        for number in range(people)
    ]
    laboratory = session(
        0.2, users, object__kind=thing, object__axes=axes, coupling__stiffness_npm=stiffness, link__delay_ms=delay_ms,
        link__jitter_ms=jitter_ms, link__loss=loss, link__duplicate=duplicate, link__reorder=reorder, seed=seed,
    )  # fmt: skip
    summary = of_laboratory(laboratory)
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    for user in summary["users"]:
        energy, link = user["energy"], user["link"]
        assert energy["up_margin_j"] is None or energy["up_margin_j"] >= -LENT_J - 1e-12
        assert abs(energy["device_leak_j"]) < 1e-9
        for direction in (link["up"], link["down"]):
            assert direction["sent"] == direction["applied"] + direction["late"] + direction["lost"]
    assert summary["server"]["energy_balance_error_j"] < 1e-9


def test_what_passivity_does_not_promise_is_seen() -> None:
    """Position drift and intermittent forces grow with the delay; neither grows on."""
    near, far = session(1.2, link__delay_ms=FRAME_MS), session(1.2, link__delay_ms=8 * FRAME_MS)
    for laboratory in (near, far):
        assert of_laboratory(laboratory)["passive"]
        assert laboratory.people[0].core.coupling.controlled > 0
    assert 0 < near.room.world.controlled < far.room.world.controlled


@pytest.mark.long
def test_hands_at_rest_find_their_proxies_again() -> None:
    """Drift compensation brings them together after a second of the worst network conditions."""
    users = [{"name": name, "hand": "reach&amplitude_m=0.03&stroke_s=1.0&rest_s=3"} for name in "ab"]
    laboratory = session(3.5, users, link__delay_ms=20.0, link__jitter_ms=20.0, link__loss=0.3, link__burst_frames=4.0)
    for user in of_laboratory(laboratory)["users"]:
        assert user["proxy_m"] == pytest.approx(user["position_m"], abs=4e-3)


def test_a_person_who_returns_begins_without_deficit() -> None:
    laboratory = Laboratory(resolve({**CONTROLLED, "users": TWO}, {"link.delay_ms": 15.625}))
    run_frames(laboratory, 128)
    laboratory.leave(0)
    while not laboratory.people[0].gone:
        laboratory.frame()
    run_frames(laboratory, 40)
    assert laboratory.room.seats[0].state == "free"
    assert abs(laboratory.people[1].core.force_n[0]) < 3.0
    laboratory.come(0)
    run_frames(laboratory, 128)
    seat = laboratory.room.seats[0]
    assert seat.on_object
    assert -LENT_J - 1e-12 <= seat.port.up_margin_j <= 0.0
    assert seat.port.used_j > 0.0
    assert not laboratory.incident


@pytest.mark.long
def test_a_lost_address_and_a_new_server_are_survived() -> None:
    laboratory = Laboratory(resolve({**CONTROLLED, "users": TWO}))
    run_frames(laboratory, 60)
    laboratory.lose_address(0)
    run_frames(laboratory, 200)
    assert laboratory.people[0].core.session.resumed == 1
    assert laboratory.room.seats[0].port is not None
    checkpoints = laboratory.kill()
    run_frames(laboratory, 60)
    assert laboratory.people[0].core.force_n == (0.0,), "stale: no force"
    laboratory.restart(checkpoints)
    run_frames(laboratory, 250)
    for person in laboratory.people:
        assert person.core.session.renewed == 1
        assert person.core.safety.state == "live"
    assert not laboratory.incident
    assert all(
        seat.port is not None and (seat.port.up_margin_j or 0.0) >= -LENT_J - 1e-12 for seat in laboratory.room.seats
    )


def test_e0_is_all_that_a_passive_session_may_have_lent_itself() -> None:
    """`passive` allows the credit in each direction, and in the whole line that of both; not a microjoule more."""
    laboratory = session(0.5)
    energy = of_laboratory(laboratory)["users"][0]["energy"]
    assert of_laboratory(laboratory)["passive"]
    assert -LENT_J <= energy["up_margin_j"] < 0.0, "it was used"
    port = laboratory.room.seats[0].port
    credit_j = 1e-3 * UNLENT_MJ
    for margin, passive in ((-credit_j, True), (-credit_j - 1e-6, False)):
        port.up_margin_j = margin
        assert of_laboratory(laboratory)["passive"] is passive
    port.up_margin_j = 0.0
    for margin, passive in ((-2.0 * credit_j, True), (-2.0 * credit_j - 1e-6, False)):
        laboratory.room.seats[0].line_margin_j = margin
        assert of_laboratory(laboratory)["passive"] is passive


def test_there_is_no_linear_model_of_it_and_the_error_says_what_to_do() -> None:
    with pytest.raises(ModelError, match=r"not linear, so there is no model of it; `cogrip lab`"):
        linear_session(resolve(CONTROLLED), estimated=False)
    with pytest.raises(ModelError, match=r"coupling\.compensate has no effect"):
        linear_session(resolve({"coupling": {"kind": "tdpa", "compensate": True}}), estimated=False)


def test_settings_of_the_wave_scheme_are_refused_or_have_no_effect() -> None:
    with pytest.raises(SettingsError, match=r'coupling\.kind = "tdpa" leave it "passive"'):
        resolve({"coupling": {"kind": "tdpa", "server_step": "paper"}})
    seat = seat_settings(resolve({"coupling": {"kind": "tdpa", "compensate": True, "stiffness_npm": 1e5}}), 0)
    assert (seat.rendered_npm, seat.predicted_stiffness(3.0)) == (1e5, None)
