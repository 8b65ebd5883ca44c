"""`cogrip devices wizard`: scripted by lines on devices in virtual time, and at a terminal of 80x24 on an emulated arm."""

import io
import os
import re
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from cogrip.cli.devices import wizard
from cogrip.cli.devices.device_setting import placed, starting_text
from cogrip.cli.terminal.problem import BadInput
from cogrip.devices.io.plugged_in import PluggedIn
from cogrip.devices.registry import make
from cogrip.devices.trial import FeltSpring

REACH = "emulated:vintage?hand=reach&amplitude_m=0.04"
ON = ""
LET_GO = FeltSpring(200.0, 0.0, 0.0, 0.0, "no samples")


@pytest.fixture
def answering(cogrip, monkeypatch):
    """Run the wizard with these lines as its input; give exit code, output and errors."""

    def run(*answers: str, arguments: tuple[object, ...] = ()) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.stdin", io.StringIO("".join(f"{answer}\n" for answer in answers)))
        code, out, err = cogrip("devices", "wizard", *arguments)
        return code, re.sub(r"\n  +", " ", out), err

    return run


def test_all_of_it_ends_with_the_address_in_a_settings_file(answering, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    code, out, _ = answering(REACH, "s", "s", ON, str(file))
    assert code == 0, out
    for words in (
        "1 of 7  device",
        "serial, vintage, 3 axes, 200 x 200 x 200 mm",
        "force at most 5 N",
        "left out: only arms on serial: and hid:",
        "left out: it knows its pose",
        "asked for 200 N/m, given 200 N/m over ",
        f"{file}: the device of anna is {REACH}; start with `cogrip demo {file}`",
        "nothing that was tried is wrong",
    ):
        assert words in out, words
    users = tomllib.loads(file.read_text())["users"]
    assert [user.get("device") for user in users] == [REACH, None]


def test_a_wrong_sign_is_named_and_ends_with_1(answering) -> None:
    address = f"{REACH}&direction=0,1,0&dir=1,1,1"
    code, out, _ = answering(ON, ON, ON, ON, "s", arguments=(address,))
    assert code == 1
    assert "6 of 7  felt stiffness\nleft out: with a wrong sign a spring may push away" in out
    assert "x: moved toward you the device says -y: see the key dir in docs/devices.md" in out
    assert "not as it should be: the sign of x; the sign of y; the sign of z" in out
    assert f"not written; use it as --device '{address}'" in out


@pytest.mark.long
def test_signs_that_are_right_and_axes_that_nobody_moves(answering) -> None:
    code, out, _ = answering(ON, ON, ON, ON, "s", arguments=(f"{REACH}&direction=0.6,0,0",))
    assert "x: grows toward you, as it should" in out
    assert "y: moved to your right the device says +x" in out  # the hand goes toward you, whatever it is asked
    assert code == 1
    code, out, _ = answering(ON, ON, ON, ON, "s", "s", arguments=("emulated:vintage?hand=hold",))
    assert code == 0
    assert out.count("it was not moved, so its sign is not known") == 3


@pytest.mark.parametrize(
    ("felt", "words"),
    [
        (FeltSpring(200.0, 219.0, 0.004, 0.8), "nothing that was tried is wrong"),
        (FeltSpring(200.0, 221.0, 0.004, 0.8), "not as it should be: the stiffness"),
        (FeltSpring(200.0, 179.0, 0.004, 0.8), "not as it should be: the stiffness"),
        (FeltSpring(200.0, 0.0, 0.001, 0.2), "it was moved by 1.0 mm only: nothing can be said"),
        (LET_GO, "not as it should be: the spring let go: no samples"),
    ],
)
def test_a_stiffness_that_is_another_one_is_told(answering, monkeypatch, felt: FeltSpring, words: str) -> None:
    monkeypatch.setattr("cogrip.devices.trial.feel", lambda *_: felt)
    code, out, _ = answering("s", "s", ON, "s", arguments=(REACH,))
    assert words in out
    assert code == ("not as it should be" in words)


def test_an_input_only_device_is_not_pushed(answering) -> None:
    code, out, _ = answering("s", "s", arguments=("spacemouse:idle",))
    assert code == 0
    assert "input only: no force reaches the hand; it moves a simulated mass" in out
    assert "6 of 7  felt stiffness\nleft out: no force reaches the hand" in out
    assert "its handle has 32 buttons" in out
    assert "its handle has 1 button, orientation" in answering(arguments=("emulated:polhem-hid",))[1]


@pytest.mark.parametrize(
    ("answers", "flags", "held", "words"),
    [
        ((ON,), (), False, "stopped before the trials, and nothing was written: mend what the check names"),
        ((ON, "s", "s", "s", ON), ("--unfit",), True, "not as it should be: the check; the spring let go: no samples"),
        (("s", "s", "s", "s", ON), (), True, "not as it should be: the spring let go: no samples"),
    ],
)
def test_an_arm_that_is_not_fit_to_be_held_is_not_held(
    answering, monkeypatch, tmp_path: Path, answers, flags, held, words
) -> None:
    """The arm answers as an emulated one; its check fails."""
    felt: list[str] = []
    monkeypatch.setattr(wizard, "record_of", lambda *_: make(REACH, axes=3).capability)
    monkeypatch.setattr(wizard, "device_check", lambda *_, **__: 1)
    monkeypatch.setattr(wizard._Wizard, "_held", lambda _, address, run: felt.append(address) or LET_GO)
    file = tmp_path / "mine.toml"
    code, out, _ = answering(*answers, arguments=("serial:/dev/cogrip-nosuch", "--settings", file, *flags))
    assert code == 1
    assert words in out
    assert ("4 of 7" in out, "stopped" in out) == (held, not held)
    assert (bool(felt), file.exists()) == (held, held)


def test_one_is_chosen_from_what_is_plugged_in(answering, monkeypatch) -> None:
    found = [PluggedIn("sim:ideal?hand=hold", "a machine"), PluggedIn("", "something"), PluggedIn("web:idle", "a page")]
    monkeypatch.setattr(wizard, "FINDERS", {"things": lambda: found})
    code, out, _ = answering("0", "3", "x", "2", "s", "s")
    assert code == 0
    assert "1  sim:ideal?hand=hold  a machine\n2  web:idle  a page\n" in out
    assert out.count("is neither a number from 1 to 2 nor an address") == 3
    assert "web:idle: web, pointer" in out


@pytest.mark.parametrize(
    ("answers", "arguments", "code", "words"),
    [
        (("q",), ("sim:phantom",), 1, "left; nothing more was changed"),
        ((), ("sim:phantom",), 1, "nobody is there to answer: run it at a terminal"),
        ((), ("sim:phantm",), 2, "did you mean 'phantom'"),
        (("s",), ("inverse:localhost:1",), 1, "nobody is there"),
        (("s", ON), ("inverse:localhost:1",), 1, "no service at localhost:1"),
        (("s", "s", "s"), ("sim:phantom", "--settings", "none/there.toml"), 1, "none/there.toml: cannot be read or written"),
        (("s", "s", "s"), ("sim:phantom", "--settings", "new.toml", "--name", "zoe"), 2, "has no user 'zoe'; there is: anna"),
    ],
)  # fmt: skip
def test_what_ends_it_early_is_told(answering, tmp_path, monkeypatch, answers, arguments, code, words) -> None:
    monkeypatch.chdir(tmp_path)
    found, out, err = answering(*answers, arguments=arguments)
    assert found == code
    assert words in out + err
    assert list(tmp_path.iterdir()) == []


# --- the settings file ------------------------------------------------------------------------------------------------

TEXT = """name = "two"  # a comment

[[users]]
name = "anna"
device = "sim:ideal"  # the old one

[[ users ]]
name = "ben"
hand = "hold"

[object]
kind = "cube"
"""


def test_a_device_is_replaced_or_added_to_the_person_named_and_all_else_stays() -> None:
    new = TEXT.replace('device = "sim:ideal"  # the old one', 'device = "serial:/dev/x?dir=1,-1,1"')
    assert placed(TEXT, "", "serial:/dev/x?dir=1,-1,1", "f") == (new, "anna", None)
    new = TEXT.replace("[[ users ]]\n", '[[ users ]]\ndevice = "replay:a \\"b\\".csv"\n')
    assert placed(TEXT, "ben", 'replay:a "b".csv', "f") == (new, "ben", None)
    assert tomllib.loads(new)["users"][1]["device"] == 'replay:a "b".csv'
    assert tomllib.loads(starting_text())["name"] == "demo", "a new file begins as the demo"


@pytest.mark.parametrize(
    ("settings", "carried_nspm", "written"),
    [
        ("[coupling]\nimpedance_nspm = 20.0\n", 8.0, 8.0), ("[coupling]\nimpedance_nspm = 20.0\n", 20.0, None),
        ("[coupling]\nimpedance_nspm = 20.0\n", 7.96, 7.9), ("[coupling]\nimpedance_nspm = 5\n", 8.0, None),
        ('[coupling]\nimpedance_nspm = "auto"\n', 8.0, None),
    ],
)  # fmt: skip
def test_a_person_gets_an_impedance_of_their_own_where_the_device_carries_less(
    settings: str, carried_nspm: float, written: float | None
) -> None:
    new, person, own = placed(settings + TEXT, "ben", "sim:ideal", "f", carried_nspm)
    assert (person, own) == ("ben", written)
    assert tomllib.loads(new)["users"][1].get("impedance_nspm") == written
    again = placed(new, "ben", "sim:ideal", "f", 0.5)[0]
    assert again.count("impedance_nspm") == (settings + TEXT).count("impedance_nspm") + (
        written is not None or "auto" not in settings
    )


def test_the_command_that_it_ends_with_is_accepted(answering, cogrip, tmp_path: Path) -> None:
    """These settings ask for 20 N s/m, and this arm carries 8."""
    file = tmp_path / "mine.toml"
    file.write_text('[coupling]\nimpedance_nspm = 20.0\n[[users]]\nname = "anna"\n[[users]]\nname = "ben"\n')
    code, out, _ = answering(REACH, "s", "s", "s", str(file))
    assert code == 0
    assert "the device carries 8 N s/m: anna gets impedance_nspm = 8" in out
    assert tomllib.loads(file.read_text())["users"][0]["impedance_nspm"] == 8.0
    code, out, err = cogrip("lab", str(file), "--set", "seconds=0.5", "--runs", str(tmp_path / "runs"))
    assert "carries" not in out + err
    assert code == 0, out + err


def test_an_impedance_that_follows_the_device_is_left_as_it_is(answering, cogrip, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    code, _, _ = answering(REACH, "s", "s", "s", str(file))
    assert code == 0
    assert "impedance_nspm" not in file.read_text()
    code, out, err = cogrip("lab", str(file), "--set", "seconds=0.5", "--runs", str(tmp_path / "runs"))
    assert "carries" not in out + err
    assert code == 0, out + err


def test_an_arm_whose_axes_are_swapped_gets_no_spring(answering, monkeypatch) -> None:
    monkeypatch.setattr("cogrip.cli.devices.tried_response.response.faults", lambda *_: ["x: a push moves y: swapped"])
    code, out, _ = answering("s", ON, "s", arguments=(REACH,))
    assert code == 1
    assert "it does not move as its record says: x: a push moves y: swapped" in out
    assert "asked for" not in out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('users = [{name = "anna"}]', "write it yourself, below .*of anna: device = "),
        ('[[users]]\nname = """anna\ndevice = "x"\n"""', "write it yourself"),
        ("name = 'none'", "has no user ''; there is: none"),
        ("name = ", "not valid TOML"),
    ],
)
def test_a_text_that_is_written_otherwise_is_left_alone(text: str, words: str) -> None:
    with pytest.raises(BadInput, match=words):
        placed(text, "", "sim:ideal", "f")


# --- at a terminal ----------------------------------------------------------------------------------------------------

posix = pytest.mark.skipif(os.name != "posix", reason="needs pseudo-terminals")


@pytest.fixture
def wizard_at(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Start the wizard at a terminal of 80x24; where a hand is given, `{arm}` is a serial arm that it moves."""
    from tests.devices.test_pseudo_terminal import emulating
    from tests.terminal import Terminal

    arm, terminals = str(tmp_path / "arm"), []
    emulated = emulating(arm, "serial")
    emulate = next(emulated)

    def start(address: str, *flags: object, hand: str = "") -> Terminal:
        if hand:
            emulate("--hand", hand)
        terminals.append(Terminal("devices", "wizard", address.format(arm=arm), *flags, columns=80))
        return terminals[-1]

    yield start
    for terminal in terminals:
        terminal.close()
    for _ in emulated:
        pass


@posix
def test_at_a_terminal_of_80x24_on_an_emulated_arm(wizard_at, tmp_path: Path, monkeypatch) -> None:
    """A serial arm behind a pseudo-terminal: pushed, calibrated, its signs seen live, and written down."""
    from tests.live.held_arms import AWAY
    from tests.stalls import MACHINE_STALLED

    monkeypatch.setenv("COGRIP_CALIBRATION", str(tmp_path / "calibration"))
    file = tmp_path / "mine.toml"
    terminal = wizard_at("serial:{arm}", "--settings", file, hand="reach&amplitude_m=0.03&stroke_s=1.5")
    try:
        terminal.see("Put the arm in mid-range")
        terminal.type("s\n")  # the hand that moves it would be taken for noise
        for words in ("Put the arm into its home pose", "No force flows", "move it 3 cm toward you"):
            terminal.see(words)
            terminal.type("\n")
        assert "vintage is calibrated" in terminal.screen.text
        terminal.see(r"x +[-+]\d+\.\d mm +y +[-+]\d+\.\d mm")
        terminal.see("x: (grows|moved)")
        for axis in ("to your right", "up"):
            terminal.see(f"move it 3 cm {axis}")
            terminal.type("\n")
        terminal.see("left out: with a wrong sign")
        assert terminal.end() == 1  # the hand moves along x, whatever it is asked
        assert max(map(len, terminal.screen.text.splitlines())) <= 80
        assert len(re.findall(r"^x +[-+]", terminal.screen.text, re.MULTILINE)) == 3  # one line a trial, drawn anew
        assert tomllib.loads(file.read_text())["users"][0]["device"] == f"serial:{tmp_path / 'arm'}"
    except AssertionError:
        if re.search(f"{AWAY}|no samples", terminal.screen.text):
            pytest.skip(f"{MACHINE_STALLED}: {terminal.screen.text}")
        raise


@posix
def test_enters_from_before_the_question_start_no_force(wizard_at) -> None:
    terminal = wizard_at("emulated:vintage?hand=hold")
    for words, keys in (
        ("No force flows", "s\n\n\n\n"),
        ("small forces push", "s\n"),
        ("A weak spring", "s\n"),
        ("Settings file to write", "s\n"),
    ):
        terminal.see(words)
        terminal.type(keys)
    assert terminal.end() == 0
    assert not re.search("asked for|it was moved by", terminal.screen.text)


@pytest.mark.long
@posix
def test_a_free_arm_is_checked_on_the_way(wizard_at) -> None:
    # a machine that is busy answers too late to be fit: what is checked is that the wizard goes through it
    terminal = wizard_at("serial:{arm}?pose=home", "--unfit", hand="push&force_n=0")
    terminal.see("Put the arm in mid-range")
    terminal.type("\n")
    assert "sign, axis a" in terminal.see("fit to be held")
    terminal.see("Put the arm into its home pose")
    terminal.type("q\n")
    assert terminal.end() == 1
    assert max(map(len, terminal.screen.text.splitlines())) <= 80
