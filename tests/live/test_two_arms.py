"""`cogrip join` with two devices: one person's two seats, held and released together."""

import json
import re
import signal
from math import hypot
from pathlib import Path

import pytest

from cogrip.cli.session.live_views import FollowedRun

from tests.extent import long
from tests.live.held_arms import DEMO, WITHIN, fairly, until

SEATS = ("--set", "users.0.name=anna.1", "--set", "users.1.name=anna.2")
ARMS = ("--device", "sim:phantom?hand=reach", "--device", "sim:phantom?hand=reach&amplitude_m=0.03")
HOLD = "sim:phantom?hand=hold"


def force_n(runs: Path, name: str) -> float:
    """Return the size of the newest force in the recording of a person [N], 0 before there is one."""
    tick = FollowedRun(next(runs.glob(f"*-{name}"), runs)).tick(name)
    return hypot(*(each or 0.0 for each in tick.force_n)) if tick else 0.0


def summaries(folder: Path) -> dict[str, dict]:
    """Return each person's part of the summaries below `folder`, by name; of those who were there."""
    found = [json.loads(path.read_text())["users"] for path in folder.glob("*/summary.json")]
    return {user["name"]: user for users in found for user in users if user["ticks"]["run"]}


@pytest.mark.long
@pytest.mark.parametrize(("kicked", "encryption"), [(True, "--encrypted"), long(False, "--insecure")])
def test_two_arms_take_the_seats_of_their_person_and_leave_together(run, serve, tmp_path, kicked, encryption):
    state = tmp_path / "state"
    server, port = serve(DEMO, *SEATS, encryption, "--state", state)
    link = re.search(r"join demo as player: .*'(cogrip:\S+)'", server.said)
    place = link[1] if link else f"127.0.0.1:{port}"
    time = () if kicked else ("--seconds", "1")
    person = run("join", place, "--name", "anna", *ARMS, *time, "--runs", tmp_path / "a", "--no-report")
    if kicked:
        for name in ("anna.1", "anna.2"):
            until(lambda name=name: force_n(tmp_path / "a", name) > 0.01, f"{name} pushes")
        assert run("kick", "anna.2", "--state", state).end() == 0
    assert person.end() == kicked, person.said
    assert ("\nanna.2 has let go: the other arm lets go and leaves as well\n" in person.said) is kicked
    for name in ("anna.1", "anna.2"):
        assert f"\n{name}: engaged: force ramps in\n" in person.said
        assert re.search(f"\n{name}: the session (is over|broke off), no force is left: ", person.said)
        server.hear(f"{name} (left|was kicked)")
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    for folder in ("a", "server"):
        arms = summaries(tmp_path / folder)
        assert sorted(arms) == ["anna.1", "anna.2"]
        assert min(arm["peak_force_n"] for arm in arms.values()) > 0.005, "both were engaged"
    assert {arm["force_n"][0] for arm in summaries(tmp_path / "a").values()} == {0.0}


@pytest.mark.long
def test_where_only_one_seat_is_free_nothing_is_held(run, serve, tmp_path):
    server, port = serve(DEMO)
    place = f"127.0.0.1:{port}"
    other = run("join", place, "--device", HOLD, "--runs", tmp_path / "other", "--no-report")
    other.hear("holds cube")
    person = run("join", place, "--name", "zoe", *ARMS, "--runs", tmp_path / "a", "--no-report")
    assert person.end() == 1, person.said
    assert "the room has no seat 'zoe.1': two free ones are taken" in person.said
    assert (
        "cogrip: arm 2 with sim:phantom?hand=reach&amplitude_m=0.03: the server refused: the room is full"
        in person.said
    )
    server.hear("ben left")
    (arm,) = summaries(tmp_path / "a").values()
    assert arm["peak_force_n"] == 0.0, "its clutch was held"


@fairly
def test_while_one_arm_is_in_a_fault_the_other_is_held_off(start, at_terminal, tmp_path):
    server = start(
        "serve", DEMO, "--port", "0", "--seconds", "600", "--runs", tmp_path / "server", "--no-report", *WITHIN, *SEATS
    )
    place = server.hear(r"listening on (\S+:\d+)")[1]
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    anna = at_terminal("join", place, "--name", "anna", "--device", arm.address, *ARMS[2:], columns=120)
    if "device stall" in anna.see("anna.2: engaged|fault"):
        pytest.skip(f"this machine took the processor away for too long: {anna.screen.text}")
    anna.see("anna.1: engaged")
    arm.fault("silence 0.2")
    anna.see(held_off := "anna.2: held off: the tool stands still")
    anna.type("2 set clutch=off\n")
    anna.see("anna.2: set: clutch=off")
    anna.type("2 c\n")
    anna.see("anna.2: held off: `c` has no effect")
    anna.type("r\n")
    anna.see("anna.1: re-armed: force ramps in\n[\\s\\S]*anna.2: engaged: force ramps in")
    anna.type("1 c\n")
    anna.see("anna.1: clutched: the tool stands still")
    arm.fault("silence 0.2")
    anna.see(f"{held_off}[\\s\\S]*{held_off}")
    anna.type("r\n")
    anna.see("anna.1: re-armed: [\\s\\S]*anna.1: re-armed: [\\s\\S]*anna.2: engaged: force ramps in")
    anna.type("\x1a\x03")
    assert anna.end() == 0, anna.screen.text
    assert anna.screen.text.count("anna.2: clutched") == 0, "an order of the other arm's"
