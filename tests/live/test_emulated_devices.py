"""Live sessions with emulated arms behind pseudo-terminals: other processes, which speak the wires' own bytes.

Nothing sleeps: a test waits for what a process says, or for its end. What an arm truly does is asked of its emulator.
"""

import json
import os
import pty
import re
import signal
import sys

import pytest

from tests.extent import long
from tests.live.held_arms import BROKEN_LAW, OWN_TERMINAL, WITHIN, WITHOUT_PLOTS, fairly
from tests.live.test_live_sessions import FEW_FRAMES, FEW_TICKS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")


@pytest.mark.long
@fairly
def test_a_silent_arm_is_without_force_until_its_person_re_arms_it(start, session):
    annas, bens = start.arm("anna-arm", "reach&amplitude_m=0.02"), start.arm("ben-arm", "hold")
    anna = session.join("anna", annas.address, "--rearm")
    ben = session.join("ben", bens.address, "--rearm")
    annas.pushes(True)
    anna.popen.send_signal(signal.SIGUSR1)  # before there is a fault: it must not leave one later
    anna.expected_stalls = 1
    annas.fault("silence 0.3")
    reason = anna.hear(r"fault, force released: (.*)")[1]
    assert reason.startswith("device stall")
    anna.hear(rf"`r` and Enter here, or `kill -USR1 {anna.popen.pid}`, re-arms")
    annas.pushes(False)
    session.until_state("anna", "fault")
    assert "re-arm" not in anna.said.partition("re-arms; Ctrl-C leaves")[2]
    anna.popen.send_signal(signal.SIGUSR1)
    anna.hear("re-armed: force ramps in")
    session.until_state("anna", "live")
    annas.pushes(True)
    session.until_state("ben", "live")
    session.close(anna, ben)
    assert anna.said.count("re-armed:") == 1
    assert session.summary("anna")["users"][0]["force_n"] == [0.0]
    counted = session.summary("anna")["server"]["dropped"]
    assert counted["reply late"] >= 10
    assert counted["fault"] == 1
    assert f"reply late {counted['reply late']}" in anna.said
    assert "fault, " not in ben.said
    assert annas.force_n() == bens.force_n() == 0.0


@pytest.mark.long
@fairly
def test_an_arm_that_was_unplugged_wants_its_calibration_before_it_is_re_armed(start, session):
    annas, bens = start.arm("anna-arm", "hold"), start.arm("ben-arm", "reach&amplitude_m=0.02")
    refused = start("join", f"127.0.0.1:{session.port}", "--device", annas.port)
    assert refused.end() == 1
    assert re.search(
        r"its pose is not known, so there would be no force: .*`cogrip devices calibrate \S+`", refused.said
    )

    session.server.hear("anna left: device: ")  # the seat is free again at once

    def calibrate() -> None:
        done = start("devices", "calibrate", annas.port, "--yes")
        assert done.end() == 0, done.said
        assert "vintage is calibrated; the tip of the home pose is at" in done.said

    calibrate()
    anna, ben = session.join("anna", annas.port, "--rearm"), session.join("ben", bens.address, "--rearm")
    annas.pushes(True)
    annas.fault("unplug")
    assert "lost" in anna.hear(r"fault, force released: (.*)")[1]
    anna.popen.send_signal(signal.SIGUSR1)
    assert "plug the device in" in anna.hear("not re-armed: (.*)")[1]
    assert annas.force_n() == 0.0
    annas.tell("mend")
    annas.hear("plugged in again")
    anna.popen.send_signal(signal.SIGUSR1)
    # behind the same terminal as before, or behind another one, which was never calibrated
    assert re.search(
        r"(was plugged in again since it was calibrated on|its pose is not known, so) .*`cogrip devices calibrate",
        anna.hear("not re-armed: .*")[0],
    )
    session.until_state("anna", "fault")
    calibrate()
    anna.popen.send_signal(signal.SIGUSR1)
    anna.hear("re-armed: force ramps in")
    annas.pushes(True)
    session.until_state("ben", "live")
    session.close(anna, ben)


@fairly
def test_r_and_enter_at_a_terminal_re_arm(start, session):
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    master, slave = pty.openpty()
    try:
        person = session.join("anna", arm.address, stdin=slave, code=OWN_TERMINAL)
        person.expected_stalls = 1
        arm.fault("silence 0.2")
        person.hear("`r` and Enter here")
        os.write(master, b"what now?\n")
        person.hear("'what now.' is no order: `m TEXT` sets a marker")
        os.write(master, b"r\n")
        person.hear("re-armed: force ramps in")
        os.write(master, b"r\n")  # in no fault
        session.until_state("anna", "live")
        os.write(master, b"m the lamp\n")
        session.server.hear("anna marker: the lamp")
        os.write(master, b"c\n")
        person.hear("clutched: the tool stands still")
        arm.pushes(False)
        os.write(master, b"c\n")
        person.hear("engaged: force ramps in")
        arm.pushes(True)
        os.write(master, b"set force_scale=20\n")
        person.hear("not set: force_scale = '20' is out of 0.1 to 10")
        os.write(master, b"set force_scale=0.5\n")
        person.hear("set: force_scale=0.5; force ramps in")
        session.server.hear("anna holds: position_scale=1 force_scale=0.5 ")
        os.write(master, b"\x03")  # Ctrl-C
        assert person.end() == 0, person.said
        assert person.said.count("re-arming") == 1
    finally:
        os.close(master)
        os.close(slave)


@fairly
def test_a_session_that_ends_in_a_fault_did_not_end_well(start, session):
    arm = start.arm("arm", "hold")
    person = session.join("anna", arm.address, "--rearm")
    person.expected_stalls = 2  # it is said again at the end
    arm.fault("silence")
    person.hear("re-arms; Ctrl-C leaves")
    person.popen.send_signal(signal.SIGINT)
    assert person.end() == 1
    assert "no force is left: it ended in a fault: device stall" in person.said


@pytest.mark.parametrize("wire", ["serial", long("haply")])
@fairly
def test_no_force_is_left_of_a_client_that_was_killed(start, session, wire):
    """On a serial: line the firmware's watchdog sees to it, on a haply: one the guard process: that firmware has none."""
    hand = "reach&amplitude_m=0.01" if wire == "haply" else "reach&amplitude_m=0.02"
    annas = start.arm("anna-arm", hand, wire=wire)
    anna, ben = session.join("anna", annas.address), session.join("ben", "sim:phantom?hand=hold")
    annas.pushes(True)
    anna.popen.kill()
    annas.pushes(False)
    session.server.hear("anna has been silent for too long and lost the seat")
    session.close(ben)


@pytest.mark.parametrize("number", [long(signal.SIGINT), signal.SIGTERM])
@fairly
def test_a_signal_ends_with_no_force(start, session, number):
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    person = session.join("anna", arm.address)
    arm.pushes(True)
    person.popen.send_signal(number)
    assert person.end() == 0, person.said
    assert arm.force_n() == 0.0


@pytest.mark.long
@fairly
def test_an_error_in_the_loop_ends_with_no_force(start, session):
    """One that nobody thought of, while the arm pushes."""
    arm = start.arm("arm", "reach&amplitude_m=0.02")
    person = session.join("anna", arm.address, code=BROKEN_LAW)
    assert person.end() == 1
    assert "ZeroDivisionError: a bug in the law, as it pushes" in person.said
    assert arm.force_n() == 0.0
    arm.tell("status")
    assert float(arm.hear(r"most so far ([\d.]+) N")[1]) > 0.05


@fairly
def test_an_arm_that_vanishes_ends_a_session_that_nobody_watches(start, session):
    annas = start.arm("anna-arm", "reach&amplitude_m=0.02")
    anna, ben = session.join("anna", annas.address), session.join("ben", "sim:phantom?hand=hold")
    annas.pushes(True)
    annas.fault("unplug")
    assert anna.end() == 1
    assert "the session broke off, no force is left: device: serial:" in anna.said
    assert "plug it in again, then re-arm" in anna.said
    assert annas.force_n() == 0.0
    session.server.hear("anna left")
    session.close(ben)


@pytest.mark.long
@fairly
def test_the_demo_with_two_arms(start, tmp_path):
    """Counts that are no clocks; the numbers are those of `dev.py bench devices`."""
    arms = [start.arm("a", "reach&amplitude_m=0.03"), start.arm("b", "reach&amplitude_m=0.03&delay_s=0.25")]
    devices = [word for arm in arms for word in ("--device", arm.address)]
    demo = start("demo", "--seconds", "3", "--runs", tmp_path / "runs", *devices, *WITHIN, code=WITHOUT_PLOTS)
    code = demo.end()
    (folder,) = (tmp_path / "runs").iterdir()
    said = "".join(log.read_text() for log in folder.glob("*.log"))
    demo.said += said
    assert code == 0, demo.said
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["passive"]
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    assert summary["object"]["travel_m"] > 0.01
    for user in summary["users"]:
        assert user["state"] == "idle"
        assert user["force_n"] == [0.0]
        assert user["peak_force_n"] > 0.1
        assert user["travel_m"] > 0.01
        assert user["ticks"]["due"] >= user["ticks"]["run"] > FEW_TICKS
        assert user["link"]["applied"] > FEW_FRAMES
        for direction in ("up", "down"):
            link = user["link"][direction]
            assert link["sent"] == link["applied"] + link["late"] + link["lost"]
    assert (folder / "report.html").exists()
    for arm in arms:
        assert arm.force_n() == 0.0


@fairly
def test_an_emulated_arm_without_a_wire_is_held_live_too(start, session):
    """Its firmware's time is that of the ticks."""
    person = session.join("anna", "emulated:vintage?hand=reach&amplitude_m=0.02&faults=silence@0.5+0.2", "--rearm")
    person.expected_stalls = 1
    person.hear("fault, force released: device stall")
    person.popen.send_signal(signal.SIGUSR1)
    person.hear("re-armed: force ramps in")
    session.close(person)
    assert session.summary("anna")["server"]["dropped"]["reply late"] >= 10


# --- arms made ready --------------------------------------------------------------------------------------------------
