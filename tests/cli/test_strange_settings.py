"""Settings and hands that no session can have: one line that names the file and the cure, and exit code 2."""

import os
from pathlib import Path

import pytest

from cogrip.cli.settings.shipped_settings import shipped

from tests.cli.command import Cogrip

DEEP = 20_000


LISTS, TABLES = "[" * DEEP + "]" * DEEP, "{a=" * DEEP + "1" + "}" * DEEP


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("deep.toml", f"name = {LISTS}\n"),
        ("tables.toml", f"name = {TABLES}\n"),
        ("keys.toml", f"{'.'.join('a' * (DEEP // 4))} = 1\n"),
        ("deep.json", f'{{"name": {LISTS}}}'),
        ("list.json", "[1]"),
    ],
)
def test_files_that_are_nested_too_deep_or_hold_no_table(
    empty_folder: Path, cogrip: Cogrip, name: str, text: str
) -> None:
    Path(name).write_text(text)
    problems = cogrip.err("lab", name)
    assert problems.startswith(f"cogrip: {name}: ")
    assert ("holds no table of settings" in problems) == (name == "list.json")
    assert len(problems.splitlines()) == 1
    assert len(problems) < 400


@pytest.mark.parametrize("value", [LISTS, TABLES], ids=["lists", "tables"])
def test_values_of_flags_that_are_nested_too_deep(cogrip: Cogrip, value: str) -> None:
    assert "cogrip: --set seed: the value is nested too deep" in cogrip.err("lab", "demo", "--set", f"seed={value}")
    assert "nested too deep" in cogrip.err("sweep", "demo", "--vary", f"seed={value}")


BLAMED = {
    "lab demo --set coupling.stifness_npm=1": "--set coupling.stifness_npm: there is no such setting; did you mean",
    "lab demo --set coupling.stiffness_npm=-1": "--set coupling.stiffness_npm: expects a number of at least 0, in N/m; got -1",
    "lab demo --set users.7.name=x": "--set users.7.name: there is no user number 7",
    "lab demo --set seed=2 --set users.0.nam=x": "--set users.0.nam: there is no such setting; did you mean users.0.name?",
    "lab demo --set rates.device_hz=1000": "--set rates.device_hz",
    "lab demo --set users.0.name=ben": "--set users.0.name=ben: users: the name 'ben' stands twice",
    "lab demo --set object.kind=scene --set object.axes=3 --set object.file=none.xml": "--set object.file: ",
    "lab demo --set link.trace=none.csv": "--set link.trace: ",
    "lab demo --set object.kind=globe": "--set object.kind: ",
    "lab room.toml --set seed=2": "room.toml: coupling.stifness_npm: ",
    "relay --to 127.0.0.1:1 --seed -1": "--seed: seed: expects",
    "relay --to 127.0.0.1:1 --profile wifi --set link.profile=wlan": "--set link.profile: expects",
}


@pytest.mark.parametrize("command", BLAMED)
def test_what_is_wrong_is_blamed_on_the_flag_or_the_file_that_gave_it(
    empty_folder: Path, cogrip: Cogrip, command: str
) -> None:
    Path("room.toml").write_text("[coupling]\nstifness_npm = 1\n")
    assert cogrip.err(command).startswith(f"cogrip: {BLAMED[command]}")


@pytest.mark.parametrize("last_s", ["1e308", "1e9", "14401"])
@pytest.mark.parametrize(("key", "what"), [("hand", "csv:{}/hand.csv&"), ("device", "replay:{}/hand.csv?")])
def test_a_recorded_hand_that_lasts_for_ever(tmp_path: Path, cogrip: Cogrip, last_s: str, key: str, what: str) -> None:
    (tmp_path / "hand.csv").write_text(f"t_s,x_m\n0,0\n{last_s},0.1\n")
    address = f"{what.format(tmp_path)}time=t_s&x=x_m"
    problems = cogrip.err("lab", "demo", "--set", f"users.0.{key}={address}", "--runs", tmp_path / "runs")
    assert "s long, and 14400 s is the most" in " ".join(problems.split())


@pytest.mark.parametrize("command", ["lab", "advise", "serve"])
def test_settings_that_may_never_end(tmp_path: Path, cogrip: Cogrip, command: str) -> None:
    os.mkfifo(path := tmp_path / "f.toml")
    out, problems = cogrip.texts(command, path, code=2)
    assert out == ""
    assert problems == (
        f"cogrip: {path}: is no regular file; give a settings file, or a name of `cogrip configs`, such as demo\n"
    )


def test_settings_that_a_shell_pipes(cogrip: Cogrip) -> None:
    ours, theirs = os.pipe()
    os.write(theirs, shipped("demo").read_bytes())
    os.close(theirs)
    assert cogrip("advise", f"/dev/fd/{ours}", "--no-laboratory")[0] == 0
    os.close(ours)
