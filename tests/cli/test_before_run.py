"""Warnings and refusals before a session is run: `lab`, `demo`, `compare`, `replay --what-if`."""

import json
from pathlib import Path

import pytest

from tests.cli.spoiled_runs import Cogrip

DEMO = str(Path(__file__).resolve().parents[2] / "configs" / "demo.toml")
STIFF_ARM = ("--set", "coupling.impedance_nspm=50")
WORDS = "anna, ben: b = 50 N s/m is more than device sim:phantom carries"
CURE = "set coupling.impedance_nspm to 25.6 or less; --allow-unstable runs it all the same"


pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize("command", [["lab", DEMO], ["demo", "--config", DEMO]])
def test_more_than_a_device_carries_is_refused_with_what_would_do(
    cogrip: Cogrip, tmp_path: Path, command: list[str]
) -> None:
    code, out, err = cogrip(*command, *STIFF_ARM)
    assert (code, out) == (2, "")
    [refused] = [line for line in err.splitlines() if "refused: " in line]
    assert WORDS in refused
    assert refused.endswith(CURE)
    assert "warning: NOT stable at any stiffness" in err
    assert list(tmp_path.iterdir()) == [], "nothing is left behind"


def test_what_is_said_to_do_does(cogrip: Cogrip) -> None:
    code, out, err = cogrip("lab", DEMO, "--set", "coupling.impedance_nspm=25.6", "--set", "seconds=2", "--json", "-")
    assert code == 0
    assert "warning" not in err
    assert json.loads(out)["passive"]


def test_it_is_run_where_that_is_allowed_and_said_all_the_same(cogrip: Cogrip) -> None:
    code, out, err = cogrip("lab", DEMO, *STIFF_ARM, "--allow-unstable", "--set", "seconds=0.5", "--json", "-")
    assert code in (0, 1)
    assert f"warning: {WORDS}" in err
    assert json.loads(out)["seconds"] == 0.5


def test_a_persons_own_value_is_named(cogrip: Cogrip) -> None:
    code, _, err = cogrip("lab", DEMO, "--set", "users.1.impedance_nspm=50")
    assert code == 2
    assert "set users.1.impedance_nspm to 25.6 or less" in err


def test_virtual_coupling_that_no_stiffness_holds_is_refused_and_one_that_this_does_not_warns(cogrip: Cogrip) -> None:
    coupling = ("--set", "coupling.kind=coupling", "--set", "seconds=0.5", "--json", "-")
    code, _, err = cogrip("lab", DEMO, *coupling)
    assert code == 1, "it diverges, and is run: that is what a baseline is for"
    assert "warning: NOT stable: spectral radius 1.13" in err
    code, _, err = cogrip(
        "lab", DEMO, *coupling, "--set", "coupling.damping_nspm=22", "--set", "link.profile=satellite"
    )
    assert code == 2
    assert "refused: NOT stable at any stiffness" in err
    would_do = err.rpartition("damping_nspm to ")[2].split()[0]
    code, _, err = cogrip(
        "lab", DEMO, *coupling, "--set", f"coupling.damping_nspm={would_do}", "--set", "link.profile=satellite"
    )
    assert "at any stiffness" not in err


@pytest.mark.parametrize(
    ("command", "address"),
    [
        (["demo", "--config", DEMO, "--device"], "serial:/dev/null?model=vintage&pose=home"),
        (["join", "127.0.0.1:1", "--device"], "haply:/dev/null?model=2diy"),
    ],
)
def test_hardware_is_never_held_with_more_than_it_carries(cogrip: Cogrip, command: list[str], address: str) -> None:
    code, _, err = cogrip(*command, address, "--allow-unstable")
    assert code == 2
    assert f"--allow-unstable: {address} is hardware" in err, "it is not even opened"
    assert "leave the flag out" in err


def test_an_implausible_hand_is_refused_whatever_is_allowed(cogrip: Cogrip, tmp_path: Path) -> None:
    for command in (
        ["lab", DEMO],
        ["demo", "--config", DEMO],
        ["compare", DEMO],
        ["sweep", DEMO, "--vary", "seed=1,2"],
    ):
        allowed = ["--allow-unstable"] if command[0] != "sweep" else []
        code, _, err = cogrip(*command, "--set", "users.0.hand=reach&amplitude_m=30", *allowed)
        assert code == 2, command
        assert "refused: anna: the hand means to move by 30 m along x" in err, command
    code, _, err = cogrip("join", "127.0.0.1:1", "--device", "sim:phantom?hand=reach&amplitude_m=30")
    assert code == 2
    assert "the hand means to move by 30 m" in err
    assert list(tmp_path.iterdir()) == []


def test_what_if_goes_by_the_recorded_devices_and_says_its_verdict(cogrip: Cogrip, tmp_path: Path) -> None:
    assert cogrip("lab", DEMO, "--set", "seconds=1", "--runs", "runs")[0] == 0
    [run] = Path("runs").iterdir()
    code, _, err = cogrip("replay", run, "--what-if", *STIFF_ARM, "--runs", "other")
    assert code == 2
    assert CURE in err
    assert not Path("other").exists()
    code, out, _ = cogrip("replay", run, "--what-if", "--set", "coupling.impedance_nspm=25", "--runs", "other")
    assert code == 0
    assert "✓ Passive" in out
    assert "✓ Stable" in out
    code, out, err = cogrip(
        "replay", run, "--what-if", "--set", "coupling.kind=coupling", "--set", "link.delay_ms=40", "--runs", "other"
    )
    assert code == 1, "the changed session is judged by the same rules"
    assert "warning: NOT stable: spectral radius" in err


def test_methods_are_compared_where_they_are_unstable_but_not_beyond_their_devices(
    cogrip: Cogrip, tmp_path: Path
) -> None:
    compare = ["compare", DEMO, "--profiles", "own", "--seeds", 1, "--workers", 1, "--set", "seconds=2", "--out", "out"]
    code, _, err = cogrip(*compare, "--methods", "coupling")
    assert code == 0
    assert "warning: coupling on own: NOT stable" in err
    code, _, err = cogrip(*compare, "--methods", "wave", *STIFF_ARM)
    assert code == 2
    assert f"refused: {WORDS}" in err
