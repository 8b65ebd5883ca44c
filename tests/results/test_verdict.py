"""The three judgements of a run, on accounts made for each rule, then on whole sessions."""

import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.wire.accounts import DeviceAccount, LinkCount, PlayoutAccount, SeatAccount
from cogrip.results.reading.folder import summary_text
from cogrip.results.reading.summary_values import worst_margin
from cogrip.results.verdict import felt_as_intended as judgement
from cogrip.results.verdict.verdict import came, felt, judgements, passive, stable, succeeded
from cogrip.results.verdict.verdict_text import verdict
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import UserRecord

from tests.sim.told_accounts import SEAT, person, summarised


def port(**device: Any) -> UserRecord:
    return person(device=DeviceAccount(**{"margin_j": 0.1, **device}))


def tones(summary: dict[str, Any]) -> str:
    return " ".join(each.tone for each in judgements(summary))


def test_all_is_well_where_every_end_said_so() -> None:
    summary = summarised(person())
    assert tones(summary) == "good good good"
    assert summary["passive"] is True
    assert succeeded(summary)
    assert felt(summary).sentence == "Felt as intended; 363 N/m at rest, predicted, not measured."


def test_how_a_scene_felt_of_which_hands_had_copies_is_not_known() -> None:
    summary = summarised(person())
    for gates, scene, tone in (({}, None, "good"), (None, {}, "good"), ({}, {}, "warn")):
        told = {**summary, "gates": gates, "server": {**summary["server"], "scene": scene}}
        assert felt(told).tone == tone
        assert ("copy of its own" in felt(told).sentence) is (tone == "warn")


@pytest.mark.parametrize(
    ("margin_j", "passed", "tone"),
    [
        (0.0, True, "good"),
        (-0.9e-12, True, "good"),
        (-1.1e-12, False, "bad"),
        (-9.0, False, "bad"),
        (math.nan, False, "bad"),
        (-math.inf, False, "bad"),
        (math.inf, False, "bad"),
        (None, None, "warn"),
    ],
)
def test_a_device_that_gives_more_than_came_in_is_not_passive(margin_j: float | None, passed: bool, tone: str) -> None:
    summary = summarised(port(margin_j=margin_j, leak_j=0.5))
    assert summary["passive"] is passed
    read = msgspec.json.decode(summary_text(summary))
    for each in (summary, read):
        assert passive(each).tone == tone
        assert succeeded(each) is (tone == "good")
    if margin_j == -9.0:
        assert "the device end of anna gave out more energy, 500 mJ at most, than came in" in passive(summary).sentence
        assert passive(summary).brief == "not passive: device of anna −9 J"


def test_what_was_never_told_is_not_good() -> None:
    untold = {
        "nothing was reported of the device port of anna": person(device=DeviceAccount()),
        "the server reported nothing of the line of anna": person(seat=None),
        "no account was reported by the client of anna": UserRecord("anna", None, SEAT),
        "nothing was received from the client of anna": UserRecord("anna", None, replace(SEAT, up=LinkCount())),
    }
    for words, user in untold.items():
        summary = summarised(user)
        assert (summary["passive"], passive(summary).tone) == (None, "warn")
        assert words in passive(summary).sentence
        assert not succeeded(summary)
    old = summarised(person(device=DeviceAccount()))
    assert tones(old) == "warn warn warn"
    assert [old["users"][0][key] for key in ("oscillates", "at_limit", "leak_j")] == [None] * 3


def test_a_seat_that_nobody_took_has_nothing_to_tell() -> None:
    nobody = UserRecord("ben", None, SeatAccount((0.0,), None, None, LinkCount()))
    assert tones(summarised(person(), nobody)) == "good good good"
    assert not came(summarised(nobody))
    assert came(summarised(person()))
    assert not succeeded(summarised(nobody))


@pytest.mark.parametrize(
    ("asked_npm", "tone", "words"),
    [
        (None, "good", "363 N/m at rest, predicted"),
        (471.0, "good", "363 N/m at rest, predicted"),
        (472.0, "warn", "Softer than asked for: 363 N/m at rest of 472 N/m asked for, predicted, not measured."),
        (1453.0, "warn", "Softer than asked for: 363 N/m at rest of 1453 N/m asked for, predicted, not measured."),
    ],
)
def test_what_was_asked_for_stands_beside_what_was_felt(asked_npm: float | None, tone: str, words: str) -> None:
    judged = felt(summarised(replace(person(), asked_npm=asked_npm)))
    assert (judged.tone, words in judged.sentence) == (tone, True)


def test_stiffness_that_is_measured_and_not_predicted_is_said_to_be_measured() -> None:
    summary = summarised(person(felt_stiffness_npm=1000.0))
    summary["users"][0].update(
        asked_stiffness_npm=1000.0, predicted_stiffness_npm=None, not_predicted=None, local="scene"
    )
    assert felt(summary).sentence == "Felt as intended; 1000 N/m at rest, as measured."
    summary["users"][0]["felt_stiffness_npm"] = None
    judged = felt(summary)
    assert judged.tone == "warn"
    assert judged.sentence == "How stiff it felt is not known: anna rested on no fixed shape that a client renders."
    summary["users"][0]["asked_stiffness_npm"] = None
    assert felt(summary).tone == "good"


@pytest.mark.parametrize(("peak_grip_n", "tone"), [(0.04, "good"), (0.06, "warn"), (3.1, "warn")])
def test_how_stiff_a_gripper_felt_is_not_known(peak_grip_n: float, tone: str) -> None:
    summary = summarised(person())
    summary["users"][0].update(asked_stiffness_npm=None, peak_grip_n=peak_grip_n)
    judged = felt(summary)
    assert judged.tone == tone
    assert ("How stiff it felt is not known: the gripper's, with anna," in judged.sentence) == (tone == "warn")


def test_a_fault_in_an_earlier_seat_session_counts() -> None:
    """One margin of the client, of the seat and of the device port; oscillation; divergence."""
    for before, energy in (
        (person(down_margin_j=-0.5), "500 mJ more"),
        (person(seat=replace(SEAT, line_margin_j=-0.5)), "500 mJ more"),
        (port(margin_j=-1.0), "than came in"),
    ):
        summary = summarised(replace(person(), earlier=(before,)))
        assert summary["passive"] is False
        assert passive(summary).tone == "bad"
        assert energy in passive(summary).sentence
        if before.client.device.margin_j == 0.1:
            assert worst_margin(summary["users"])[0] == -0.5
    assert stable(summarised(replace(person(), earlier=(port(oscillates=True),)))).tone == "bad"
    assert summarised(replace(person(), earlier=(person(unstable=True),)))["unstable"]


def test_a_force_that_oscillated_is_not_stable_and_was_not_felt_as_intended() -> None:
    summary = summarised(port(oscillates=True), person("ben"))
    assert tones(summary) == "good bad warn"
    assert "the force on anna oscillated" in stable(summary).sentence
    assert summary["passive"]
    assert not succeeded(summary)
    [anna, ben] = summary["users"]
    assert (anna["predicted_stiffness_npm"], anna["not_predicted"]) == (None, "the force oscillated")
    assert (ben["predicted_stiffness_npm"], ben["not_predicted"]) == (363.0, None)


def replaced(share: float, **playout: int) -> UserRecord:
    """A person to whom this share of 1000 frames that were sent was lost, and replaced."""
    lost = round(1000 * share)
    down = LinkCount(sent=1000, received=1000 - lost, applied=1000 - lost, lost=lost)
    return person(playout=PlayoutAccount(concealed=lost, **playout), down=down)


@pytest.mark.parametrize(
    ("within", "beyond", "words"),
    [
        (
            port(at_limit=judgement.MOST_LIMITED),
            port(at_limit=0.05),
            "a limit of anna's device held the force in 5.0 %",
        ),
        (
            port(controlled=judgement.MOST_CONTROLLED),
            port(controlled=0.2),
            "anna's device port changed what is felt in 20 %",
        ),
        (replaced(judgement.MOST_REPLACED), replaced(0.6), "60 % of the frames to anna were missing and replaced"),
        (person(), person(state="degraded"), "anna ended without force"),
        (person(felt_stiffness_npm=300.0), person(felt_stiffness_npm=100.0), "felt 100 N/m at rest, where 363 N/m"),
    ],
)
def test_what_took_the_place_of_the_force_law_warns_and_does_not_fail(
    within: UserRecord, beyond: UserRecord, words: str
) -> None:
    assert felt(summarised(within)).tone == "good"
    summary = summarised(beyond, person("ben"))
    assert felt(summary).tone == "warn"
    assert words in felt(summary).sentence
    assert "more" not in felt(summary).sentence
    assert succeeded(summary), "it is no failure of the session"


def test_others_of_whom_it_is_true_are_counted() -> None:
    both = summarised(port(at_limit=0.05), person("ben", device=DeviceAccount(at_limit=0.5, margin_j=0.0)))
    assert (
        "a limit of ben's device held the force in 50 % of the ticks (and more than 1 % with 1 more)"
        in felt(both).sentence
    )


def test_frames_that_a_server_that_was_gone_did_not_send_were_due_as_well() -> None:
    """After 1000 frames nothing came for 3000: three quarters were replaced, not three times as many as were sent."""
    gone = person(playout=PlayoutAccount(concealed=3000, longest_gap=3000))
    assert "75 % of the frames to anna were missing and replaced" in felt(summarised(gone)).sentence


def test_where_no_force_was_met_nothing_was_felt() -> None:
    assert felt(summarised(person(peak_force_n=0.0))).sentence == "Nothing was felt: no hand met a force."
    assert felt(summarised(person(peak_force_n=0.0, peak_torque_nm=0.002))).tone == "good", "a hand that turns a wheel"
    assert felt(summarised(person(peak_force_n=0.0), person("ben"))).tone == "good"


@pytest.mark.parametrize(
    ("user", "why"),
    [
        (person(), None),
        (port(at_limit=0.02), "the force was at a limit in 2.0 % of the ticks"),
        (port(controlled=0.06), "the device port changed what is felt in 6.0 % of the ticks"),
        (replaced(0.06), "6.0 % of the frames to it were replaced"),
        (replaced(0.012, longest_gap=10), "1.2 % of the frames to it were replaced"),
        (replaced(0.011, longest_gap=10), None),
        (replaced(0.0, repeated=6, skipped=5), "the playout's depth changed at 1.1 % of the frames"),
        (replaced(0.0, repeated=5, skipped=5), None),
        (person(state="fault"), "it ended in fault"),
    ],
)
def test_a_stiffness_is_predicted_only_where_the_line_was_linear(user: UserRecord, why: str | None) -> None:
    [row] = summarised(user)["users"]
    assert row["not_predicted"] == why
    assert row["predicted_stiffness_npm"] == (None if why else 363.0)


def test_a_person_who_was_kicked_is_named() -> None:
    kicked = summarised(person(state="idle", reason="the server said goodbye: kicked by the administrator"))
    left = summarised(person(state="idle", reason="stopped (SIGINT)"))
    assert ("warn", "anna did not leave by choice: the server said goodbye: kicked by the administrator.") in verdict(
        kicked
    )
    assert not any("by choice" in text for _, text in verdict(left))


# Whole sessions, as a user would run them -------------------------------------------------------------------------------


def session(**changes: Any) -> dict[str, Any]:
    table = {"seconds": 1.5, "users": [{"name": "anna"}, {"name": "ben", "hand": "hold"}], **changes}
    return run_laboratory(resolve(table)).summary


@pytest.mark.parametrize("axes", [1, 3])
def test_an_ordinary_session_is_all_good(axes: int) -> None:
    asked = {"stiffness_npm": 300.0}  # which a delay of 10 ms leaves at 240 N/m
    assert tones(session(object={"axes": axes}, link={"delay_ms": 10.0}, coupling=asked)) == "good good good"


def test_a_session_in_which_nobody_moves_says_that_nothing_was_felt() -> None:
    summary = session(users=[{"name": "anna", "hand": "hold"}, {"name": "ben", "hand": "hold"}])
    assert felt(summary).sentence == "Nothing was felt: no hand met a force."
    assert succeeded(summary)


def test_a_push_beyond_the_motors_is_not_green() -> None:
    summary = session(object={"kind": "wall"}, users=[{"name": "anna", "hand": "push&force_n=20"}])
    assert felt(summary).tone == "warn"
    assert summary["users"][0]["state"] == "fault"
    assert not succeeded(summary)


def test_an_unstable_coupling_is_not_green() -> None:
    summary = session(coupling={"kind": "coupling", "stiffness_npm": 2000.0}, link={"delay_ms": 30.0})
    assert stable(summary).tone == "bad"
    assert felt(summary).tone == "warn"
    assert not succeeded(summary)


def test_what_only_clients_of_others_say_in_their_favour_is_said_to_be_theirs() -> None:
    summary = summarised(person())
    summary["users"][0]["claimed"] = {"unstable": False, "saturated": False, "left": False, "down_margin_j": 0.0}
    assert passive(summary).tone == "good"
    assert passive(summary).sentence.endswith("than had been put in, nor, say the clients, any motors.")
    summary["users"][0]["energy"] |= {"line_reserve_j": 2e-3, "device_reserve_j": 0.2}
    assert passive(summary).sentence.endswith("any motors; least reserve after the first second 2 mJ in a whole line.")


@pytest.mark.parametrize(("loss", "passed"), [(0.0, False), (0.05, True)])
def test_credit_is_lent_where_frames_were_missing_alone(loss: float, passed: bool) -> None:
    """A decimator that lets aliases through creates energy on a line that loses nothing."""
    settings = load(Path("compare"), {"coupling.decimator": "none", "seconds": 6.0, "link.loss": loss})
    summary = run_laboratory(settings).summary
    worst = worst_margin(summary["users"])
    assert worst is not None
    assert -0.08 < worst[0] < -1e-3
    assert summary["passive"] is passed
    assert passive(summary).tone == ("good" if passed else "bad")
    assert ("no frame was missing there" in passive(summary).sentence) is not passed


def test_what_clients_of_others_say_against_themselves_is_judged_by_the_credit() -> None:
    summary = summarised(person())
    summary["users"][0]["claimed"] = {"unstable": False, "saturated": False, "left": False, "down_margin_j": 0.0}
    summary["credit_j"] = 1e-3
    for margin_j, tone in ((-0.9e-3, "good"), (-1.1e-3, "warn")):
        summary["users"][0]["energy"]["down_margin_j"] = margin_j
        assert passive(summary).tone == tone
    assert "gave out 1.1 mJ too much" in passive(summary).sentence


@pytest.mark.parametrize(
    ("seat", "words"),
    [
        (SeatAccount((0.0,), None, None, LinkCount()), "Nobody took the seat of ben."),  # as a server has an empty one
        (None, "The client of ben reported no account: what it alone knows is missing."),  # nor is the server's known
        (SEAT, "The client of ben reported no account: what it alone knows is missing."),  # frames of it came
        (replace(SEAT, up=LinkCount()), "The client of ben never sent anything: what it alone knows is missing."),
    ],
)
def test_a_seat_that_nobody_took_and_a_client_without_an_account_are_told_apart(
    seat: SeatAccount | None, words: str
) -> None:
    said = [text for _, text in verdict(summarised(person(), UserRecord("ben", None, seat)))]
    assert [text for text in said if "ben" in text and not text.startswith("Whether")] == [words]
