"""A person who took a seat twice: nothing that was known of the first seat session is lost."""

import io
import json
import math

import msgspec
import pytest
from rich.console import Console

from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.protocol.accounts import ClientAccount, LinkCount, Percentiles, SeatAccount, TickCount
from cogrip.protocol.settings import resolve, seat_settings
from cogrip.server.participants import MOST_EARLIER, Seat, SeatSession
from cogrip.sim.runs.folder import summary_text
from cogrip.sim.runs.report.tables import people_table
from cogrip.sim.runs.summary import UserRecord, of_laboratory, of_room, summarise
from cogrip.sim.runs.summary_values import worst_margin
from cogrip.sim.runs.verdict_text import verdict
from cogrip.sim.session.laboratory import Laboratory

CLIENT = ClientAccount(
    (0.0,), (0.0,), 1.0, 0.1, None, None, 0.0, 0.0, LinkCount(), Percentiles(), TickCount(5, 5), False, "idle", "went"
)
SEAT = SeatAccount((0.0,), 0.0, 0.0, LinkCount(sent=7))


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
    table = people_table(json.loads(summary_text(summary)))
    assert not isinstance(table, str)
    assert table.head == ["", "anna, seat session 1", "anna, seat session 2", "ben"]
    assert not {"peak torque", "peak force of the gripper"} & {
        row.label for row in table.rows if not isinstance(row, str)
    }
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(terminal_summary(summary))
    said = console.export_text()
    assert "anna (1)" in said
    assert "anna (2)" in said


@pytest.mark.parametrize("where", ["client", "seat"])
def test_a_fault_in_the_first_seat_session_counts(where: str) -> None:
    client, seat = CLIENT, SEAT
    if where == "client":
        client = msgspec.structs.replace(CLIENT, down_margin_j=-0.5)
    else:
        seat = msgspec.structs.replace(SEAT, line_margin_j=-0.5)
    user = UserRecord("anna", CLIENT, SEAT, (UserRecord("anna", client, seat),))
    summary = summarise(name="lab", seed=1, seconds=1.0, tank_mj=0.0, users=[user], room=None, dropped={})
    assert not summary["passive"]
    worst = worst_margin(summary["users"])
    assert worst[0] == -0.5
    assert "gave out 0.5 J more" in verdict(summary)[0][1].replace("500 mJ", "0.5 J")
    gone = UserRecord("anna", CLIENT, SEAT, (UserRecord("anna", msgspec.structs.replace(CLIENT, diverged=True), SEAT),))
    assert summarise(name="lab", seed=1, seconds=1.0, tank_mj=0.0, users=[gone], room=None, dropped={})["diverged"]


def test_of_many_seat_sessions_the_worst_is_kept() -> None:
    seat = Seat(seat_settings(resolve({}), 0))
    for number in range(40):
        margin_j = {5: -0.25, 7: math.nan}.get(number, 0.0)
        seat.account, seat.last = CLIENT, msgspec.structs.replace(SEAT, up_margin_j=margin_j, up=LinkCount(sent=number))
        seat.close_seat_session()
        assert seat.account is None
        assert seat.last is None
    kept = [seat_session.seat.up.sent for seat_session in seat.earlier]
    assert len(kept) == MOST_EARLIER
    assert {5, 7} <= set(kept)
    assert SeatSession(None, SEAT).least_margin() == 0.0


@pytest.mark.parametrize("margin_j", [math.nan, math.inf, -math.inf])
def test_a_margin_that_is_no_number_is_called_so(margin_j: float) -> None:
    for client, seat in (
        (msgspec.structs.replace(CLIENT, down_margin_j=margin_j), SEAT),
        (CLIENT, SeatAccount((0.0,), margin_j, margin_j, LinkCount())),
    ):
        summary = summarise(
            name="lab", seed=1, seconds=1.0, tank_mj=0.0, users=[UserRecord("a", client, seat)], room=None, dropped={}
        )
        for told in (summary, json.loads(summary_text(summary))):
            tone, words = verdict(told)[0]
            if summary["passive"]:
                assert margin_j == math.inf
                continue
            assert tone == "bad"
            assert words.startswith(
                "Not passive as far as can be told: an end reported an energy margin that is no number"
            )
            assert "gave out" not in words
