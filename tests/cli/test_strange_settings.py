"""Settings and hands that no session can have: one line that names the file and the cure, and exit code 2."""

import json
import os
from pathlib import Path

import pytest

from cogrip.cli.session.shipped_settings import shipped

from tests.cli.command import Cogrip

DEEP = 20_000


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("deep.toml", f"name = {'[' * DEEP}{']' * DEEP}\n"),
        ("tables.toml", f"name = {'{a=' * DEEP}1{'}' * DEEP}\n"),
        ("keys.toml", f"{'.'.join('a' * (DEEP // 4))} = 1\n"),
        ("deep.json", f'{{"name": {"[" * DEEP}{"]" * DEEP}}}'),
    ],
)
def test_settings_that_are_nested_too_deep(
    tmp_path: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, name: str, text: str
) -> None:
    monkeypatch.setenv("COLUMNS", "300")
    path = tmp_path / name
    path.write_text(text)
    problems = cogrip.err("lab", path)
    assert problems.startswith(f"cogrip: {path}: ")
    assert len(problems.splitlines()) == 1
    assert len(problems) < 400


@pytest.mark.parametrize("value", ["[" * DEEP + "]" * DEEP, "{a=" * DEEP + "1" + "}" * DEEP])
def test_values_of_flags_that_are_nested_too_deep(cogrip: Cogrip, value: str) -> None:
    problems = cogrip.err("lab", shipped("demo"), "--set", f"seed={value}")
    assert "cogrip: --set seed: the value is nested too deep" in problems
    assert "nested too deep" in cogrip.err("sweep", shipped("demo"), "--vary", f"seed={value}")


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        ("coupling.stifness_npm=1", "--set coupling.stifness_npm: there is no such setting; did you mean"),
        ("coupling.stiffness_npm=-1", "--set coupling.stiffness_npm: expects a number of at least 0, in N/m; got -1"),
        ("users.7.name=x", "--set users.7.name: there is no user number 7"),
        ("seed=2 users.0.nam=x", "--set users.0.nam: there is no such setting; did you mean users.0.name?"),
        ("rates.device_hz=1000", "--set rates.device_hz"),
        ("users.0.name=ben", "--set users.0.name=ben: users: the name 'ben' stands twice"),
        ("object.kind=scene object.axes=3 object.file=none.xml", "--set object.file: "),
        ("link.trace=none.csv", "--set link.trace: "),
        ("object.kind=globe", "--set object.kind: "),
    ],
)
def test_what_a_flag_has_wrong_is_not_blamed_on_the_file(cogrip: Cogrip, flags: str, words: str) -> None:
    given = [word for flag in flags.split() for word in ("--set", flag)]
    problems = cogrip.err("lab", "demo", *given)
    assert problems.replace("\n", " ").startswith(f"cogrip: {words}")


def test_what_the_file_has_wrong_is_not_blamed_on_a_flag(tmp_path: Path, cogrip: Cogrip) -> None:
    path = tmp_path / "room.toml"
    path.write_text("[coupling]\nstifness_npm = 1\n")
    assert (
        cogrip.err("lab", path, "--set", "seed=2")
        .replace("\n", "")
        .startswith(f"cogrip: {path}: coupling.stifness_npm: ")
    )


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("relay --to 127.0.0.1:1 --seed -1", "--seed: seed: expects"),
        ("relay --to 127.0.0.1:1 --profile wifi --set link.profile=wlan", "--set link.profile: expects"),
    ],
)
def test_another_flag_is_named_where_it_gave_the_setting(cogrip: Cogrip, command: str, words: str) -> None:
    assert cogrip.err(command).startswith(f"cogrip: {words}")


def test_settings_that_are_no_table(tmp_path: Path, cogrip: Cogrip) -> None:
    path = tmp_path / "list.json"
    path.write_text(json.dumps([1]))
    assert "holds no table of settings" in cogrip.err("lab", path)


@pytest.mark.parametrize("last_s", ["1e308", "1e9", "14401"])
@pytest.mark.parametrize("key", ["hand", "device"])
def test_a_recorded_hand_that_lasts_for_ever(tmp_path: Path, cogrip: Cogrip, last_s: str, key: str) -> None:
    (tmp_path / "hand.csv").write_text(f"t_s,x_m\n0,0\n{last_s},0.1\n")
    what = "csv:" if key == "hand" else "replay:"
    path = tmp_path / "room.toml"
    path.write_text(f'seconds = 0.1\n[[users]]\nname = "a"\n{key} = "{what}{tmp_path}/hand.csv&time=t_s&x=x_m"\n')
    if key == "device":
        path.write_text(path.read_text().replace(".csv&", ".csv?"))
    problems = cogrip.err("lab", path, "--runs", tmp_path / "runs")
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
