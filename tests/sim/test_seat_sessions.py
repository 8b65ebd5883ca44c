"""A person who took a seat twice: nothing that was known of the first seat session is lost."""

import io
import json
import math

import msgspec
import pytest
from rich.console import Console

from cogrip.cli.runs.summary_table import terminal_summary
from cogrip.protocol.accounts import LinkCount
from cogrip.protocol.settings import resolve, seat_settings
from cogrip.server.participants import MOST_EARLIER, Seat, SeatSession
from cogrip.sim.runs.folder import summary_text
from cogrip.sim.runs.report.tables import people_table
from cogrip.sim.runs.summary import of_laboratory, of_room
from cogrip.sim.session.laboratory import Laboratory

from tests.sim.told_accounts import CLIENT, SEAT


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
