"""`cogrip devices ...` as its users type it: what is found, listed and refused, with its exit code and its cure.

Arms on emulated wires are in tests/live.
"""

import io
import json
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

import cogrip.cli.devices.find as find
from cogrip.cli.devices.listing import NOT_RUN
from cogrip.devices.device import DeviceError
from cogrip.devices.hid.enumeration import MBED_ID, TEENSY_ID, USAGE, VARIANTS, Found
from cogrip.devices.io.plugged_in import (
    ARDUINO_VID,
    HAPLY_BOARDS,
    TEENSY_SERIAL,
    PluggedIn,
    hid_devices,
    plugged_in_lines,
    stable_names,
)
from cogrip.devices.io.serial_line import SerialLine
from cogrip.devices.registry import describe, is_real, make, schemes

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = CONFIGS / "demo.toml"
RULES = CONFIGS / "99-cogrip.rules"
GONE = "/dev/cogrip-nosuch"


@pytest.fixture(autouse=True)
def elsewhere(empty_folder, monkeypatch):
    """Read and write nothing of this user."""
    monkeypatch.setenv("COGRIP_CALIBRATION", str(empty_folder / "calibration"))


def port(device, vid=None, pid=None, product=None, serial_number=None):
    return SimpleNamespace(device=device, vid=vid, pid=pid, product=product, serial_number=serial_number)


# --- find -------------------------------------------------------------------------------------------------------------


def test_a_teensy_is_named_by_the_link_that_stays():
    ports = [port("/dev/ttyACM0", *TEENSY_SERIAL, "USB Serial", "12345")]
    link = "/dev/serial/by-id/usb-Teensyduino_USB_Serial_12345-if00"
    (found,) = plugged_in_lines(ports, {"/dev/ttyACM0": link})
    assert found.address == f"serial:{link}"
    assert "16c0:0483 at /dev/ttyACM0, serial number 12345" in found.text
    make(found.address, axes=3)
    ports = [port(f"/dev/ttyACM{number}", *TEENSY_SERIAL) for number in (2, 0, 1)]
    found = plugged_in_lines(ports, {"/dev/ttyACM1": link})
    assert [each.address for each in found] == ["serial:/dev/ttyACM0", f"serial:{link}", "serial:/dev/ttyACM2"]


@pytest.mark.parametrize("pid", HAPLY_BOARDS)
def test_a_haply_board_may_be_another_arduino(pid):
    (found,) = plugged_in_lines([port("/dev/ttyACM3", ARDUINO_VID, pid, "Arduino Due")], {})
    assert found.address == "haply:/dev/ttyACM3"
    make(f"{found.address}?model=2diy", axes=2)
    assert f"2341:{pid:04x}" in found.text
    assert "does not say which arm" in found.text


@pytest.mark.parametrize(
    ("vid", "pid"), [(0x16C0, 0x0486), (0x16C1, 0x0483), (ARDUINO_VID, 0x0043), (0x0403, 0x6001), (None, None)]
)
def test_a_port_of_anything_else_is_no_address(vid, pid):
    (found,) = plugged_in_lines([port("/dev/ttyUSB0", vid, pid)], {"/dev/ttyUSB0": "/dev/serial/by-id/x"})
    assert found.address == ""
    assert "unknown device" in found.text
    assert "/dev/ttyUSB0" in found.text


def test_links_are_followed_to_their_nodes(tmp_path):
    (tmp_path / "node").touch()
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-arm").symlink_to("../node")
    assert stable_names(tmp_path / "by-id") == {str((tmp_path / "node").resolve()): str(tmp_path / "by-id" / "usb-arm")}
    assert stable_names(tmp_path / "none") == {}


def test_hid_arms_are_told_apart_by_serial_number_else_by_path():
    mbed = Found("/dev/hidraw1", MBED_ID, "S1", "HID DEVICE", USAGE)
    bare = Found("/dev/hidraw0", MBED_ID, "", "HID DEVICE", USAGE)
    teensy = Found("/dev/hidraw4", TEENSY_ID, "77", "Teensyduino RawHID", USAGE)
    assert [found.address for found in hid_devices([teensy, mbed, bare, mbed])] == [
        "hid:woodenhaptics?variant=mbed14&path=/dev/hidraw0",
        "hid:woodenhaptics?variant=mbed14&serial=S1",
        "hid:woodenhaptics?variant=teensy64&serial=77",
    ]
    for found in hid_devices([teensy, mbed, bare]):
        make(found.address, axes=3)
    text = hid_devices([mbed])[0].text
    assert "variant=mbed8" in text
    assert "aluhaptics" in text, "a report does not say which arm it is"


@pytest.mark.parametrize(
    "other",
    [
        Found("/dev/hidraw2", TEENSY_ID, "77", "Teensyduino RawHID", (0xFFC9, 0x0004)),  # its debug output
        Found("1-2:1.1", TEENSY_ID, "77", "Teensyduino RawHID", (0, 0), 1),  # the same by libusb, which tells no usages
        Found("/dev/hidraw2", MBED_ID, "", "Pong", USAGE),
        Found("/dev/hidraw2", (0x046D, 0xC52B), "", "USB Receiver", (1, 6)),
    ],
)
def test_what_only_looks_alike_is_no_arm(other):
    assert hid_devices([other]) == []


def test_find_goes_on_where_one_finder_fails_and_says_what_to_do_where_none_is_known(cogrip, monkeypatch):
    assert cogrip.out("devices find"), "on this machine"

    def broken():
        raise DeviceError("hid: needs the package hidapi")

    found = [PluggedIn("serial:/x", "an arm")]
    monkeypatch.setattr(find, "FINDERS", {"HID devices": broken, "serial ports": lambda: found})
    out = cogrip.out("devices find")
    assert "HID devices: hid: needs the package hidapi" in out
    assert "serial:/x  an arm" in out
    assert "none found" not in out
    found[:] = [PluggedIn("", "serial port at /dev/ttyUSB0: unknown")]
    assert re.search(r"at /dev/ttyUSB0: unknown\n(.*\n)*none found: plug one in", cogrip.out("devices find"))


# --- udev -------------------------------------------------------------------------------------------------------------


def rules():
    return [line for line in RULES.read_text().splitlines() if line and not line.startswith("#")]


def matching(subject, vid, pid):
    """Rules for devices of this kind and these numbers; one without a product is for all of a vendor."""
    numbers = re.compile(rf'{subject}.*{{idVendor}}=="{vid:04x}"(.*{{idProduct}}=="{pid:04x}"|(?!.*idProduct))')
    return [line for line in rules() if numbers.match(line)]


def test_every_rule_is_one():
    item = re.compile(r'(KERNEL|SUBSYSTEM|ATTRS?\{\w+\}|ENV\{\w+\}|MODE|GROUP|TAG)(==|=|\+=)"[^"]*"')
    for line in rules():
        for part in line.split(", "):
            assert item.fullmatch(part), (part, line)
        assert ("MODE" in line) == ("GROUP" in line) == ("uaccess" in line), line
        assert "0666" not in line, "nobody else on the machine is to push a hand"


def test_rules_let_every_device_be_used_that_find_knows():
    for usb_id in {variant.usb_id for variant in VARIANTS.values()}:
        for subject in (r'KERNEL=="hidraw\*"', 'SUBSYSTEM=="usb"'):  # both backends of hidapi
            (rule,) = matching(subject, *usb_id)
            assert 'MODE="0660"' in rule
    for usb_id in [TEENSY_SERIAL, *((ARDUINO_VID, pid) for pid in HAPLY_BOARDS)]:
        (rule,) = matching('SUBSYSTEM=="tty"', *usb_id)
        for words in ('MODE="0660"', 'ENV{ID_MM_DEVICE_IGNORE}="1"', 'ENV{ID_MM_PORT_IGNORE}="1"', 'TAG+="uaccess"'):
            assert words in rule
        (device,) = matching('SUBSYSTEM=="usb"', *usb_id)
        assert "ID_MM_DEVICE_IGNORE" in device


def test_udev_takes_the_rules():
    udevadm = shutil.which("udevadm")
    if not udevadm or subprocess.run([udevadm, "verify", "--help"], capture_output=True, check=False).returncode:
        pytest.skip("needs udevadm with the command verify (systemd 254)")
    done = subprocess.run([udevadm, "verify", str(RULES)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


# --- list -------------------------------------------------------------------------------------------------------------


def test_list_marks_what_has_not_been_run_on_hardware(cogrip):
    assert "3 buttons, orientation" in cogrip.out("devices", "list", "inverse")
    whole = re.sub(r"\n  +", " ", cogrip.out("devices"))  # with the lines that hang below
    heads = {line.partition(":")[0]: line for line in whole.splitlines() if line.partition(": ")[0] in schemes()}
    assert set(heads) == set(schemes())
    for scheme, line in heads.items():
        assert (NOT_RUN in line) == (is_real(f"{scheme}:") and scheme != "web"), line  # a pointer is no hardware
    assert NOT_RUN in heads["serial"]
    assert NOT_RUN not in heads["sim"]


def test_list_shows_every_number_of_axes_that_a_device_gives(cogrip):
    rows = [line.split() for line in cogrip.out("devices").splitlines()]
    axes = {row[0]: row[1] for row in rows if len(row) > 1}
    shown = {"omega3": "3", "omega7": "3/4", "delta6": "3/6", "sigma7": "3-6", "lambda7": "3-6"}
    assert {model: axes[f"forcedimension:0?model={model}"] for model in shown} == shown


def test_list_as_json_has_the_records_as_they_are(cogrip, tmp_path):
    out = cogrip.out("devices", "list", "--axes", 2, "--json", "-")
    answer = json.loads(out)
    assert {device["address"] for device in answer["devices"]} == {listing.address for listing in describe(axes=2)}
    by_address = {device["address"]: device for device in answer["devices"]}
    vintage = by_address["serial:/dev/ttyACM0?model=vintage"]
    assert vintage["axes"] == 2
    assert vintage["workspace_m"] == [[-0.1, 0.1]] * 2
    assert (vintage["slew_nps"], vintage["speed_mps"]) == (1000.0, 1.5)
    assert vintage["real"]
    assert [name for name, each in answer["families"].items() if each["input_only"]] == ["gamepad", "spacemouse", "web"]
    assert answer["families"]["serial"]["not_run_on_hardware"]
    assert not answer["families"]["sim"]["real"]
    assert cogrip("devices", "list", "--axes", 2, "--json", tmp_path / "list.json")[0] == 0
    assert json.loads((tmp_path / "list.json").read_text()) == answer


# --- refusals ---------------------------------------------------------------------------------------------------------

BAD = {
    "calibrate serial:": "name the port, such as serial:/dev/ttyACM0; `cogrip devices find` lists them",
    f"calibrate serial:{GONE}?model=polhm": "model: expects one of ",
    f"calibrate 'serial:{GONE}?model=vintage&pose=none' --damping": "pose=none gives no force",
    "calibrate emulated:vintage --damping": "there is nothing to calibrate or check here",
    "calibrate sim:phantom": "there is nothing to calibrate or check here",
    "check emulated:vintage --yes": "there is nothing to calibrate or check here",
    f"check serial:{GONE} --yes --current-ma 200.5": "--current-ma 200.5: give more than 0 and at most 20",
    f"check serial:{GONE} --yes --current-ma 0": "--current-ma 0: give more than 0",
    f"check serial:{GONE} --yes --current-ma nan": "--current-ma nan",
    f"check serial:{GONE} --yes --moving-s -1": "--moving-s -1: give 0 to 600",
    "check haply:/dev/ttyACM0?model=2diy --yes": "its board has no watchdog, so it is not pushed",
    "conform sim:phantom --axes 4": "axes=4 is out of 1 to 3",
    "conform sim:phantom --rate-hz 0": "--rate-hz 0 is outside 1 to ",
    "list phantm": "no address has 'phantm' in it",
    "list --axes 0": "--axes 0 is outside 1 to 3",
    "list --axes 4": "--axes 4 is outside 1 to 3",
    "emulate serial --model omega": "--model 'omega': serial has polhem, vintage, woodenhaptics-serial",
    "emulate hid --model vintage": "--model 'vintage': hid has ",
    "emulate hid --link /dev/null": "--link /dev/null: is there already and no socket",
    "emulate serial --hand wave": "unknown hand 'wave'",
    "emulate serial --powered-at-m 9 9 9": "no arm can stand at (9.0, 9.0, 9.0) m",
    "emulate serial --port 5": "--port: serial has none; use --link",
    "emulate inverse --link /tmp/x": "--link: inverse has none; use --port",
    "emulate inverse --port 65536": "--port 65536 is outside 0 to 65535",
    "emulate inverse --powered-at-m 0 0 0": "--powered-at-m: inverse knows its pose",
    "emulate inverse --model vintage": "inverse has inverse3",
}
MISSING = {
    "calibrate hid:polhem?variant=mbed8 --damping --yes": "gives no force, so nothing can be identified",
    f"check serial:{GONE} --yes": "look for its name with `cogrip devices find`",
    f"conform serial:{GONE}": "look for its name with `cogrip devices find`",
    "calibrate serial:/dev/null --yes": "serial:/dev/null: cannot be opened",
    "list --json nosuch/list.json": "--json nosuch/list.json: cannot be written",
    "emulate serial --link nosuch/arm": "nosuch",
    "emulate hid --link nosuch/arm": "--link nosuch/arm: cannot be made: No such file or directory",
    f"emulate hid --link /tmp/{'x' * 120}": "AF_UNIX path too long; name another place",
}


@pytest.mark.parametrize(
    ("expected", "arguments", "words"), [(2, *each) for each in BAD.items()] + [(1, *each) for each in MISSING.items()]
)
def test_a_refusal_names_the_cure_and_leaves_nothing(cogrip, expected, arguments, words):
    cogrip.refuses(words, f"devices {arguments}", code=expected)


@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_a_prompt_can_be_left_and_says_what_to_add_where_nobody_can_answer(cogrip, monkeypatch, command):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(SerialLine, "open", lambda _: None)
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    out, err = cogrip.texts("devices", command, f"serial:{GONE}", code=1)
    assert "Enter when it is so, Ctrl-C to leave" in out
    assert "add --yes" in err
    monkeypatch.setattr("builtins.input", interrupted)
    assert cogrip("devices", command, f"serial:{GONE}")[0] == 130


@pytest.mark.parametrize("arguments", [("calibrate",), ("calibrate", "--damping"), ("check",)])
def test_a_port_that_is_not_there_is_found_before_the_prompt(cogrip, arguments):
    out, err = cogrip.texts("devices", *arguments, f"serial:{GONE}", code=1)
    assert "look for its name with `cogrip devices find`" in err
    assert "Enter" not in out


def test_a_link_replaces_no_file(cogrip, tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    cogrip.refuses("is there already", "devices", "emulate", "serial", "--link", "thesis.tex")
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("address", [f"serial:{GONE}?pose=home", "serial:/dev/null", "hid:woodenhaptics"])
def test_virtual_time_holds_no_hardware(cogrip, address):
    """It is not even opened: what is said is not that it is missing."""
    cogrip.refuses(f"anna: {address}: is hardware, and virtual time would not wait", "lab", DEMO, "--device", address)


def test_virtual_time_holds_emulated_arms(cogrip):
    arms = "--device emulated:vintage --device emulated:woodenhaptics-serial"
    assert json.loads(cogrip.out(f"lab {DEMO} {arms} --set seconds=2 --json -"))["passive"]


@pytest.mark.parametrize("command", ["demo", "join"])
def test_a_device_that_is_not_there_ends_a_session_before_it_begins(cogrip, command):
    """A model that is not stated has to be asked for."""
    where = ["127.0.0.1:1"] if command == "join" else ["--config", DEMO]
    cogrip.refuses("look for its name with `cogrip devices find`", command, *where, "--device", f"serial:{GONE}")


@pytest.mark.parametrize("address", ["sim:phantom", "sim:ideal", "emulated:vintage"])
def test_conform_counts_the_promises_kept(cogrip, address):
    out = cogrip.out("devices", "conform", address)
    kept, every = map(int, re.search(r"(\d+) of (\d+) promises kept", out).groups())
    assert kept == every == out.count("✓")


@pytest.mark.parametrize("address", ["spacemouse:", "gamepad:", "web:pointer"])
def test_an_input_only_device_is_said_to_be_one(cogrip, address):
    out = cogrip.out("devices", "list", address.partition(":")[0])
    assert "input only: no force" in " ".join(out.split())
    assert "on a simulated mass, none reaches the hand" in " ".join(out.split())
    for command in ("check", "calibrate"):
        assert f"{address} is input only: it has no motors" in cogrip.err("devices", command, address)
