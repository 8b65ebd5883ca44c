"""Words on a summary: the verdict in sentences, the table in the terminal, numbers with units."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest

from cogrip.machine.tick_count import Percentiles, TickCount
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.wire.accounts import ClientAccount, DeviceAccount, LinkCount, SeatAccount
from cogrip.results.listing.listing import list_runs
from cogrip.results.reading.folder import summary_text
from cogrip.results.reading.summary_values import energy, number, share
from cogrip.results.reading.traces import load_run
from cogrip.results.report.tables import people_table
from cogrip.results.verdict.verdict import judgements, succeeded
from cogrip.results.verdict.verdict_text import MANY_LATE, verdict
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import UserRecord, of_laboratory, of_room
from cogrip.server.seats.participants import MOST_EARLIER, Seat, SeatSession
from cogrip.sim.laboratory import Laboratory

from tests.results.reported_runs import printed
from tests.sim.told_accounts import CLIENT, SEAT, summarised


def words(summary: dict[str, Any]) -> str:
    return " ".join(sentence for _, sentence in verdict(summary))


@pytest.mark.parametrize("strange", [{}, {"users": None}, {"users": [None, 3, {}]}, {"server": 7, "object": []}])
def test_strange_summaries_print(strange: dict[str, Any]) -> None:
    assert printed(strange)


def test_verdict_says_who_broke_passivity_why_it_was_unstable_and_which_ticks_did_not_run(
    summary: dict[str, Any],
) -> None:
    assert "Passive" in words(summary)
    assert "Stable: no number grew out of bounds" in words(summary)
    assert "Every loop ran every tick." in words(summary)
    anna, ben = summary["users"]
    anna["ticks"] = {"due": 1000, "run": 990, "late_us": {"p99": 312.4}}
    assert "anna 99.00 %" in words(summary)
    assert "within 312 µs" in words(summary)
    summary["passive"], ben["energy"]["down_margin_j"] = False, -0.0034
    assert "Not passive: the line down of ben gave out 3.4 mJ more than had been put in." in words(summary)
    summary["unstable"] = True
    assert "Not stable: numbers grew out of bounds" in words(summary)
    anna["reason"], anna["unstable"] = "the force oscillates at the hand", True
    assert "Not stable: anna: the force oscillates at the hand." in words(summary)


@pytest.mark.parametrize("width", [80, 100])
def test_terminal_table_fits(summary: dict[str, Any], width: int) -> None:
    for user in summary["users"]:
        user["position_m"] = [0.0123, -0.0123, 0.0]
        user["ticks"]["late_us"]["p99"] = 1234.5
    lines = printed(summary, width).splitlines()
    assert max(map(len, lines)) <= width
    if width == 100:
        table = "\n".join(lines[: 4 + len(summary["users"])])
        assert "…" not in table
        assert "12.3 −12.3 0.0" in table


@pytest.mark.parametrize(
    ("value_j", "text"),
    [
        (None, "not known"),
        (math.nan, "nan"),
        (0.0, "0 J"),
        (-3e-22, "0 J"),
        (-0.0034, "−3.4 mJ"),
        (12.0, "12 J"),
        (2.5e-8, "25 nJ"),
    ],
)
def test_energy_takes_the_unit_that_fits(value_j: float | None, text: str) -> None:
    assert energy(value_j) == text


def test_numbers_do_not_lie_by_rounding() -> None:
    assert share(0.999999) == "99.99 %"
    assert share(1.0) == "100 %"
    assert number(-0.0001) == "0.0"
    assert number(True) == "True"


def too_late(late: int, sent: int, frames: Any = 1, **changes: Any) -> list[str]:
    """Return the sentences where so many frames up came too late, and hardly any down."""
    link = {"up": {"late": late, "sent": sent}, "down": {"late": 1, "sent": sent}}
    playout = {key: {"depth_frames": 1.0} for key in ("up", "down")}
    user = {"name": "anna", "link": link, "playout": playout, **changes}
    return [text for tone, text in verdict({"users": [user], "playout_frames": frames}) if "too late" in text]


@pytest.mark.parametrize(
    ("late", "sent", "said"),
    [
        (MANY_LATE, 400, True),
        (MANY_LATE, 401, False),  # less than a share of 0.05
        (MANY_LATE - 1, 100, False),  # too few to say
        (310, 1000, True),
    ],
)
def test_a_depth_that_is_too_shallow_is_said_with_its_cure(late: int, sent: int, said: bool) -> None:
    assert len(too_late(late, sent)) == said
    if said:
        [text] = too_late(late, sent)
        assert text.startswith(
            f"{100 * late / sent:.0f} % of the frames from anna came too late for playout.frames = 1 "
        )
        assert '"auto" follows the network' in text


def test_nothing_is_said_of_a_depth_that_follows_or_of_what_is_not_played_out() -> None:
    assert too_late(310, 1000, "auto") == []
    assert too_late(310, 1000, None) == []
    assert too_late(310, 1000, playout={"up": None, "down": None}) == []
    assert too_late(310, 1000, link={"up": None, "down": None}) == []
    earlier = {"name": "anna", "link": {"up": {"late": 500, "sent": 1000}}, "playout": {"up": {"depth_frames": 1.0}}}
    [text] = too_late(310, 1000, earlier=[earlier])
    assert text.startswith("50 % of the frames from anna (and 5 % or more in 1 of the other directions)")


def test_a_session_with_a_fixed_depth_says_so_and_one_that_follows_does_not() -> None:
    """Frames that come too late are not felt as intended."""
    table = {"seconds": 2.0, "link": {"delay_ms": 20.0, "jitter_ms": 40.0}, "users": [{"name": "anna"}]}
    for frames, warns in ((0, True), ("auto", False)):
        summary = run_laboratory(resolve({**table, "playout": {"frames": frames}})).summary
        assert summary["playout_frames"] == frames
        assert any("came too late for playout.frames" in text for _, text in verdict(summary)) is warns
        passive, stable, felt = judgements(summary)
        assert (passive.tone, stable.tone, felt.tone) == ("good", "good", "warn")
        assert felt.sentence.startswith("How stiff it felt is not known") is not warns
        assert ("were missing and replaced" in felt.sentence) is warns
        assert not warns or summary["users"][0]["predicted_stiffness_npm"] is None


# What an end may say of itself: an account holds any float that there is ------------------------------------------------


def said(client_margin_j: float, seat_margin_j: float, other: float = 0.0) -> dict[str, Any]:
    """Return the summary of a run of which the ends say this; `other` stands for all other numbers."""
    some = Percentiles(other, other, other, other)
    client = ClientAccount(
        (other,), (other,), other, other, other, other, client_margin_j, other, LinkCount(), some,
        TickCount(1, 1, some, some), False, "live", "", device=DeviceAccount(margin_j=0.0),
    )  # fmt: skip
    seat = SeatAccount((other,), seat_margin_j, seat_margin_j, LinkCount())
    return summarised(UserRecord("anna", client, seat), tank_mj=1.0)


@pytest.mark.parametrize(
    ("margin_j", "passive"),
    [(-1e-3, True), (-1.01e-3, False), (0.0, True), (math.nan, False), (-math.inf, False), (math.inf, False)],
)
def test_a_margin_that_is_no_number_is_not_passive_and_called_so(margin_j: float, passive: bool) -> None:
    for summary in (said(margin_j, 0.0), said(0.0, margin_j)):
        for told in (summary, json.loads(summary_text(summary))):
            assert told["passive"] is passive, "null in the file is no excuse"
            tone, words = verdict(told)[0]
            assert passive or tone == "bad"
            no_number = words.startswith(
                "Not passive as far as can be told: an end reported an energy margin that is no number"
            )
            assert no_number == (not passive and not math.isfinite(margin_j))
            assert not (no_number and "gave out" in words)


@pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_null_in_the_file(strange: float) -> None:
    summary = said(strange, 0.0, strange)
    written = json.loads(summary_text(summary), parse_constant=pytest.fail)
    [user] = written["users"]
    assert (user["position_m"], user["peak_force_n"], user["energy"]["down_margin_j"]) == ([None], None, None)
    assert (user["energy"]["up_margin_j"], user["ticks"]["late_us"]["p99"]) == (0.0, None)
    assert printed(summary)
    assert printed(written)
    assert summary_text(written) == summary_text(summary)


def test_what_is_finite_is_written_as_it_is() -> None:
    summary = said(0.1, 0.2, 0.3)
    assert json.loads(summary_text(summary)) == msgspec.json.decode(msgspec.json.encode(summary))


CONTROLS = "\x1b[31m\x9b\x07\r\n\u202e\u2028\x00"


def test_texts_of_a_run_folder_that_somebody_else_wrote_are_shown_clean(finished: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished, tmp_path / "run"))
    path = folder / "summary.json"
    summary = json.loads(path.read_text())
    summary["name"] = summary["users"][0]["name"] = f"anna{CONTROLS}"
    summary["users"][0] |= {"state": f"fault{CONTROLS}", "reason": f"why{CONTROLS}", "unstable": True}
    table = printed(summary)
    path.write_text(json.dumps({**summary, "unstable": True}))
    (listed,) = list_runs(folder, lambda _: False)
    run = load_run(folder)
    for text in (table.replace("\n", ""), listed.verdict, "".join(listed.people), "".join(run.names)):
        assert text.isprintable()
    assert "why" in listed.verdict


def test_what_only_a_client_of_others_says_decides_no_verdict(summary: dict[str, Any]) -> None:
    ben = summary["users"][1]
    ben["claimed"] = {"unstable": True, "down_margin_j": -0.0034}
    ben["energy"]["down_margin_j"] = -0.0034
    assert verdict(summary)[0][0] == verdict(summary)[1][0] == "warn"
    assert succeeded(summary), "it is the client's word"
    assert "but the client of ben says that its line down gave out 3.4 mJ too much." in words(summary)
    assert "clients say that they were not: the hand of ben." in words(summary)
    summary["passive"] = False
    ben["energy"]["up_margin_j"] = -0.001
    assert "Not passive: the line up of ben gave out 1 mJ more than had been put in." in words(summary)


# A person who took a seat twice ---------------------------------------------------------------------------------------


def test_both_seat_sessions_of_a_person_are_in_its_summary() -> None:
    laboratory = Laboratory(resolve({"seconds": 6.0, "users": [{"name": "anna"}, {"name": "ben", "side": "right"}]}))
    first = laboratory.people[0]
    while laboratory.seconds < 1.0:
        laboratory.frame()
    laboratory.leave(0)
    while not first.gone or laboratory.seconds < 3.5:
        laboratory.frame()
    laboratory.come(0)
    laboratory.run()
    summary = of_laboratory(laboratory)
    anna, ben = summary["users"]
    [before] = anna["earlier"]
    assert ben["earlier"] == []
    assert before["name"] == "anna"
    assert before["travel_m"] == pytest.approx(first.core.seated.peaks.travel_m)
    assert before["link"]["up"]["sent"] < anna["link"]["up"]["sent"] + 128
    assert before["state"] != anna["state"] == "live"
    assert of_room(laboratory.room, 6.0, {})["users"][0]["earlier"][0]["link"] == before["link"]
    people = people_table(json.loads(summary_text(summary)))
    assert people.head == ["", "anna, seat session 1", "anna, seat session 2", "ben"]
    rows = {row.label for row in people.rows if not isinstance(row, str)}
    assert not {"peak torque", "peak force of the gripper"} & rows
    table = printed(summary, 120)
    assert "anna (1)" in table
    assert "anna (2)" in table


def test_of_many_seat_sessions_the_worst_is_kept() -> None:
    seat = Seat(seat_settings(resolve({}), 0))
    for sent in range(40):
        margin_j = {5: -0.25, 7: math.nan}.get(sent, 0.0)
        seat.account, seat.last = CLIENT, msgspec.structs.replace(SEAT, up_margin_j=margin_j, up=LinkCount(sent=sent))
        seat.close_seat_session()
        assert seat.account is None
        assert seat.last is None
    kept = [seat_session.seat.up.sent for seat_session in seat.earlier]
    assert len(kept) == MOST_EARLIER
    assert {5, 7} <= set(kept)
    assert SeatSession(None, SEAT).least_margin() == 0.0


def test_what_a_client_says_that_its_line_down_lent_is_in_the_words_and_decides_no_verdict(
    summary: dict[str, Any],
) -> None:
    first, *_ = summary["users"]
    first["claimed"] = {"unstable": False, "down_margin_j": -1.7e-4}
    first["playout"]["down"]["concealed"] = 1
    first["energy"]["down_margin_j"] = -1.7e-4
    assert verdict(summary)[0][0] == "good"
    told = "but by 170 µJ at most (line down of anna, says the client), within what a line may lend"
    assert told in words(summary)
