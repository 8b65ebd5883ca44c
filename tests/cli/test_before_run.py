"""Warnings and refusals before a session is run: `lab`, `demo`, `compare`, `replay --what-if`."""

import json
from pathlib import Path

import pytest

from tests.cli.command import Cogrip

DEMO = str(Path(__file__).resolve().parents[2] / "configs" / "demo.toml")
STIFF_ARM = ("--set", "coupling.impedance_nspm=50")
WORDS = "anna, ben: b = 50 N s/m is more than device sim:phantom carries"
CURE = "set coupling.impedance_nspm to 25.6 or less; --allow-unstable runs it all the same"


pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize("command", [["lab", DEMO], ["demo", "--config", DEMO]])
def test_more_than_a_device_carries_is_refused_with_what_would_do(
    cogrip: Cogrip, tmp_path: Path, command: list[str]
) -> None:
    out, err = cogrip.texts(*command, *STIFF_ARM, code=2)
    assert out == ""
    [refused] = [line for line in err.splitlines() if "refused: " in line]
    assert (WORDS in refused, refused.endswith(CURE)) == (True, True)
    assert "warning: NOT stable at any stiffness" in err
    assert list(tmp_path.iterdir()) == [], "nothing is left behind"


def test_what_is_said_to_do_does(cogrip: Cogrip) -> None:
    out, err = cogrip.texts("lab", DEMO, "--set", "coupling.impedance_nspm=25.6", "--set", "seconds=1", "--json", "-")
    assert "warning" not in err
    assert json.loads(out)["passive"]


def test_it_is_run_where_that_is_allowed_and_said_all_the_same(cogrip: Cogrip) -> None:
    code, out, err = cogrip("lab", DEMO, *STIFF_ARM, "--allow-unstable", "--set", "seconds=0.5", "--json", "-")
    assert code in (0, 1)
    assert f"warning: {WORDS}" in err
    assert json.loads(out)["seconds"] == 0.5


def test_a_persons_own_value_is_named(cogrip: Cogrip) -> None:
    assert "set users.1.impedance_nspm to 25.6 or less" in cogrip.err("lab", DEMO, "--set", "users.1.impedance_nspm=50")


def test_virtual_coupling_that_no_stiffness_holds_is_refused_and_one_that_this_does_not_warns(cogrip: Cogrip) -> None:
    coupling = ("--set", "coupling.kind=coupling", "--set", "seconds=0.5", "--json", "-")
    err = cogrip.err("lab", DEMO, *coupling, code=1)  # it diverges, and is run: that is what a baseline is for
    assert "spectral radius 1.13" in err
    far = ("lab", DEMO, *coupling, "--set", "link.profile=wan", "--set")
    err = cogrip.err(*far, "coupling.damping_nspm=22")
    assert "refused: NOT stable at any stiffness" in err
    would_do = err.rpartition("damping_nspm to ")[2].split()[0]
    assert "at any stiffness" not in cogrip(*far, f"coupling.damping_nspm={would_do}")[2]


@pytest.mark.parametrize(
    ("command", "address"),
    [
        (["demo", "--config", DEMO, "--device"], "serial:/dev/null?model=vintage&pose=home"),
        (["join", "127.0.0.1:1", "--device"], "haply:/dev/null?model=2diy"),
    ],
)
def test_hardware_is_never_held_with_more_than_it_carries(cogrip: Cogrip, command: list[str], address: str) -> None:
    err = cogrip.err(*command, address, "--allow-unstable")
    assert f"--allow-unstable: {address} is hardware" in err, "it is not even opened"
    assert "leave the flag out" in err


def test_an_implausible_hand_is_refused_whatever_is_allowed(cogrip: Cogrip) -> None:
    words = "refused: anna: the hand means to move by 30 m along x"
    for command in (
        ["lab", DEMO],
        ["demo", "--config", DEMO],
        ["compare", DEMO],
        ["sweep", DEMO, "--vary", "seed=1,2"],
    ):
        allowed = ["--allow-unstable"] if command[0] != "sweep" else []
        cogrip.refuses(words, *command, "--set", "users.0.hand=reach&amplitude_m=30", *allowed)
    device = ("--device", "sim:phantom?hand=reach&amplitude_m=30")
    cogrip.refuses("the hand means to move by 30 m", "join", "127.0.0.1:1", *device)


@pytest.mark.long
@pytest.mark.usefixtures("no_pictures")
def test_what_if_goes_by_the_recorded_devices_and_says_its_verdict(cogrip: Cogrip) -> None:
    assert cogrip("lab", DEMO, "--set", "seconds=0.5", "--runs", "runs")[0] == 0
    [run] = Path("runs").iterdir()
    assert CURE in cogrip.err("replay", run, "--what-if", *STIFF_ARM, "--runs", "other")
    assert not Path("other").exists()
    what_if = cogrip.within("replay", run, "--what-if", "--runs", "other")
    out = what_if.out("--set", "coupling.impedance_nspm=25")
    assert "✓ Passive" in out
    assert "✓ Stable" in out
    err = what_if.err(
        "--set", "coupling.kind=coupling", "--set", "link.delay_ms=40", code=1
    )  # judged by the same rules
    assert "warning: the linear model predicts growth" in err


@pytest.mark.long
@pytest.mark.usefixtures("no_pictures", "no_probes", "no_workers")
def test_methods_are_compared_where_they_are_unstable_but_not_beyond_their_devices(cogrip: Cogrip) -> None:
    compare = ["compare", DEMO, "--profiles", "own", "--seeds", 1, "--workers", 1, "--set", "seconds=2", "--out", "out"]
    err = cogrip.err(*compare, "--methods", "coupling", code=0)
    assert "warning: coupling on own: the linear model predicts growth, twofold every " in err
    assert f"refused: {WORDS}" in cogrip.err(*compare, "--methods", "wave", *STIFF_ARM)
