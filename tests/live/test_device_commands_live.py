"""Commands that make an arm ready, on emulated arms behind pseudo-terminals: check, calibrate, conform, emulate.

See held_arms: nothing sleeps.
"""

import re
import signal
import subprocess
import sys

import pytest

from cogrip.devices.registry import make

from tests.extent import long
from tests.live.held_arms import AWAY, FREE, Spoken, fairly

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")


FASTER_SWINGS = (
    "import sys; from cogrip.devices.arm import identification; identification.FREQUENCIES_HZ = (1.5, 3.0)\n"
    "identification.PERIODS, identification.SETTLE_S = 2, 0.5\n"
    "from cogrip.cli.main import main; sys.exit(main())"
)


def skip_if_away(command: Spoken) -> None:
    if re.search(AWAY, command.said):
        pytest.skip(f"this machine took the processor away for too long: {command.said}")


def signs(said: str) -> list[str]:
    return re.findall(r"([✓✗])  sign, axis ([abc])", said)


@fairly
def test_check_finds_the_signs_of_a_free_arm(start):
    """The speed of this machine decides the rest of the verdict, and so the exit code."""
    arm = start.arm("arm", FREE)
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    code = check.end()
    assert signs(check.said) == [("✓", "a"), ("✓", "b"), ("✓", "c")], check.said
    assert code == (0 if "✗" not in check.said else 1)
    assert ("NOT fit to be held" in check.said) == (code == 1)
    assert "vintage" in check.said
    assert arm.force_n() == 0.0


@fairly
def test_check_finds_an_encoder_that_is_stuck(start):
    arm = start.arm("arm", FREE)
    arm.fault("stuck")
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    assert check.end() == 1
    assert [mark for mark, _ in signs(check.said)].count("✗") == 1, check.said
    assert "NOT fit to be held" in check.said
    assert "is the amplifier enabled, the arm free, the motor plugged in?" in check.said


@fairly
def test_check_keeps_to_the_limit_of_a_motor(start):
    arm = start.arm("arm", FREE)
    check = start("devices", "check", f"{arm.port}?model=vintage&limit_ma=90,80,100", "--yes", "--moving-s", "0")
    check.end()
    assert "up, down under +-79 mA" in check.said


@pytest.mark.parametrize("number", [long(signal.SIGINT), signal.SIGTERM])
@fairly
def test_check_lets_go_when_it_is_interrupted(start, number):
    arm = start.arm("arm", "hold")
    check = start("devices", "check", arm.port, "--yes", "--moving-s", "0")
    check.hear("axis a under")
    check.popen.send_signal(number)
    assert check.end() == 130, check.said
    assert "Traceback" not in check.said
    assert arm.force_n() == 0.0
    again = start("devices", "calibrate", arm.port, "--yes")
    assert again.end() == 0, again.said


@fairly
def test_check_and_join_refuse_another_model(start, session):
    arm = start.arm("arm", "hold")
    for command in (["devices", "check", "--yes"], ["devices", "calibrate", "--yes"]):
        refused = start(*command, f"{arm.port}?model=polhem")
        assert refused.end() == 1, refused.said
        assert "it says that it is vintage, not polhem; correct the key model, or the port" in refused.said
    refused = start("join", f"127.0.0.1:{session.port}", "--device", f"{arm.port}?model=polhem")
    assert refused.end() == 1, refused.said
    assert "it says that it is vintage, not polhem; correct the key model, or the port" in refused.said


@fairly
def test_one_arm_has_one_owner(start, session):
    arm = start.arm("arm", "hold")
    person = session.join("anna", arm.address)
    refused = start("devices", "calibrate", arm.port, "--yes")
    assert refused.end() == 1
    assert "close the program that uses it" in refused.said
    session.close(person)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (None, 0)])
@fairly
def test_the_prompt_of_calibrate(start, number, code):
    arm = start.arm("arm", "hold")
    asked = start("devices", "calibrate", arm.port, stdin=subprocess.PIPE)
    asked.hear("Enter when it is so")
    if number is None:
        asked.tell("")
    else:
        asked.popen.send_signal(number)
    assert asked.end() == code, asked.said
    assert ("is calibrated" in asked.said) == (code == 0)
    assert "Traceback" not in asked.said


@pytest.mark.long
@pytest.mark.parametrize("code", [FASTER_SWINGS, long("")], ids=["two frequencies", "all"])
@fairly
def test_calibrate_identifies_damping_and_friction_of_a_free_arm(start, code):
    """Another program finds them in the record: never more than the mechanism has.

    How much of it is found depends on the loop's delays, which make the bounds smaller: in virtual time at least a fifth of the
    damping and half of the friction (`test_arm_identification`).
    """
    arm = start.arm("arm", FREE + "&damping_nspm=0.5&friction_n=0.05")
    found = start("devices", "calibrate", arm.address, "--damping", "--yes", code=code)
    code = found.end()
    skip_if_away(found)
    assert code == 0, found.said
    assert "direction 3 of 3, at most 0.18 N: do not touch the arm" in found.said
    assert arm.force_n() == 0.0
    record = make(arm.address + "&model=vintage", axes=1).capability
    assert 0.0 <= record.own_damping_nspm <= 0.5
    assert 0.0 < record.own_friction_n <= 0.05
    assert f"at least {record.own_damping_nspm:.3g} N s/m of damping and {record.own_friction_n:.3g} N" in found.said


@fairly
def test_identification_lets_go_when_it_is_interrupted_and_keeps_nothing(start):
    arm = start.arm("arm", FREE)
    found = start("devices", "calibrate", arm.address, "--damping", "--yes")
    found.hear("direction 1 of 3")
    arm.pushes(True)
    found.popen.send_signal(signal.SIGTERM)
    assert found.end() == 130, found.said
    assert "Traceback" not in found.said
    assert arm.force_n() == 0.0
    assert make(arm.address + "&model=vintage", axes=1).capability.own_friction_n == 0.0


@fairly
def test_conform_tries_an_arm_on_its_wire(start):
    arm = start.arm("arm", FREE)
    conform = start("devices", "conform", arm.address, "--yes")
    code = conform.end()
    skip_if_away(conform)
    broken = re.findall(r"✗ +(\w+)", conform.said)
    # The speed of this machine decides whether calls block, and how late a process gives its samples.
    late = {"moves_as_its_record_says"} if "later than they say" in conform.said else set()
    assert set(broken) <= {"calls_do_not_block", *late}, conform.said
    assert code == (1 if broken else 0), conform.said
    assert "promises kept" in conform.said


@fairly
def test_the_emulator_says_what_it_is_and_leaves_no_link(start):
    arm = start.arm("arm", "hold")
    assert "its counters are zero in the home pose: join it with ?pose=home" in arm.said
    arm.popen.send_signal(signal.SIGINT)
    assert arm.end() == 0
    assert not arm.link.is_symlink()
    other = start.arm("other", "hold", "--powered-at-m", "0.01", "0", "0")
    assert "its pose is not known" in other.said
    assert "pose=home" not in other.said
