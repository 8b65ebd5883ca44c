"""Warnings and refusals before a session is run: `lab`, `demo`, `compare`, `replay --what-if`."""

import json
from pathlib import Path

import pytest

from tests.cli.command import Cogrip

STIFF_ARM = "--set coupling.impedance_nspm=50"
WORDS = "anna, ben: b = 50 N s/m is more than device sim:phantom carries"
CURE = "set coupling.impedance_nspm to 25.6 or less; --allow-unstable runs it all the same"


pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.parametrize("command", ["lab demo", "demo"])
def test_more_than_a_device_carries_is_refused_with_what_would_do(cogrip: Cogrip, tmp_path: Path, command: str) -> None:
    out, err = cogrip.texts(f"{command} {STIFF_ARM}", code=2)
    (refused,) = [line for line in err.splitlines() if "refused: " in line]
    assert WORDS in refused
    assert refused.endswith(CURE)
    assert (out, list(tmp_path.iterdir())) == ("", []), "nothing is left behind"
    own = cogrip.err(f"{command} --set users.1.impedance_nspm=50")
    assert "set users.1.impedance_nspm to 25.6 or less" in own


def test_what_is_said_to_do_does_and_more_is_run_where_that_is_allowed(cogrip: Cogrip) -> None:
    out, err = cogrip.texts("lab demo --set coupling.impedance_nspm=25.6 --set seconds=1 --json -")
    assert "warning" not in err
    assert json.loads(out)["passive"]
    code, out, err = cogrip(f"lab demo {STIFF_ARM} --allow-unstable --set seconds=0.5 --json -")
    assert code in (0, 1)
    assert f"warning: {WORDS}" in err
    assert json.loads(out)["seconds"] == 0.5


def test_a_report_has_what_was_warned_of_before_the_run(cogrip: Cogrip, tmp_path: Path) -> None:
    code, _, err = cogrip(f"lab demo {STIFF_ARM} --allow-unstable --set seconds=0.5")
    assert code in (0, 1)
    (warning,) = [line for line in err.splitlines() if WORDS in line]
    (report,) = tmp_path.glob("runs/*/report.html")
    assert warning in report.read_text("utf-8")


def test_virtual_coupling_that_no_stiffness_holds_is_refused_and_one_that_this_does_not_warns(cogrip: Cogrip) -> None:
    near = "lab demo --set coupling.kind=coupling --set seconds=0.5 --json -"
    assert "spectral radius 1.13" in cogrip.err(near, code=1)  # it diverges, and is run: a baseline is for that
    far = f"{near} --set link.profile=wan --set coupling.damping_nspm="
    err = cogrip.err(f"{far}22")
    assert "refused: NOT stable at any stiffness" in err
    would_do = err.rpartition("damping_nspm to ")[2].split()[0]
    assert "at any stiffness" not in cogrip(f"{far}{would_do}")[2]


@pytest.mark.parametrize(
    ("command", "address"),
    [("demo", "serial:/dev/null?model=vintage&pose=home"), ("join 127.0.0.1:1", "haply:/dev/null?model=2diy")],
)
def test_hardware_is_never_held_with_more_than_it_carries(cogrip: Cogrip, command: str, address: str) -> None:
    err = cogrip.err(f"{command} --device '{address}' --allow-unstable")
    assert f"--allow-unstable: {address} is hardware" in err, "it is not even opened"
    assert "leave the flag out" in err


def test_an_implausible_hand_is_refused_whatever_is_allowed(cogrip: Cogrip) -> None:
    words = "the hand means to move by 30 m"
    hand = "--set 'users.0.hand=reach&amplitude_m=30'"
    for command in ("lab demo --allow-unstable", "demo --allow-unstable", "compare demo --allow-unstable"):
        cogrip.refuses(f"refused: anna: {words} along x", f"{command} {hand}")
    cogrip.refuses(f"refused: anna: {words} along x", f"sweep demo --vary seed=1,2 {hand}")
    cogrip.refuses(words, "join 127.0.0.1:1 --device 'sim:phantom?hand=reach&amplitude_m=30'")


@pytest.mark.long
@pytest.mark.usefixtures("no_pictures")
def test_what_if_goes_by_the_recorded_devices_and_says_its_verdict(cogrip: Cogrip) -> None:
    cogrip.texts("lab demo --set seconds=0.5 --runs runs")
    (run,) = Path("runs").iterdir()
    assert CURE in cogrip.err(f"replay {run} --what-if {STIFF_ARM} --runs other")
    assert not Path("other").exists()
    what_if = cogrip.within("replay", run, "--what-if", "--runs", "other")
    out = what_if.out("--set", "coupling.impedance_nspm=25")
    assert "✓ Passive" in out
    assert "✓ Stable" in out
    err = what_if.err("--set", "coupling.kind=coupling", "--set", "link.delay_ms=40", code=1)
    assert "warning: the linear model predicts growth" in err, "judged by the same rules"


@pytest.mark.long
@pytest.mark.usefixtures("no_pictures", "no_probes", "no_workers")
def test_methods_are_compared_where_they_are_unstable_but_not_beyond_their_devices(cogrip: Cogrip) -> None:
    compare = "compare demo --profiles own --seeds 1 --workers 1 --set seconds=2 --out out --methods"
    err = cogrip.err(f"{compare} coupling", code=0)
    assert "warning: coupling on own: the linear model predicts growth, twofold every " in err
    assert f"refused: {WORDS}" in cogrip.err(f"{compare} wave {STIFF_ARM}")
