"""The check of Windows' Python under Wine: what it compares, what it needs, and that it is left out by name without Wine."""

import re

import pytest

from tests.wine import environment
from tests.wine.__main__ import main
from tests.wine.checks import CHECKS, CheckError, _compare


def test_without_wine_it_is_left_out_by_name(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", "")
    assert main([]) == 0
    told = capsys.readouterr().out
    assert told.startswith("dev.py windows: skipped: no program wine; no program x86_64-w64-mingw32-gcc")


def test_an_unknown_check_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["nothing"]) == 2
    assert "there is: " + ", ".join(CHECKS) in capsys.readouterr().err


def test_summaries_are_compared_in_every_value_but_those_of_the_machine() -> None:
    ours = {"passive": True, "users": [{"force_n": [1.0, 2.0]}], "speed": 3.0}
    _compare({**ours, "speed": 4.0}, ours)
    for other in (
        {**ours, "passive": False},
        {**ours, "users": [{"force_n": [1.0, 2.0000001]}]},
        {"passive": True},
        {**ours, "x": 1},
    ):
        with pytest.raises(CheckError, match="values differ"):
            _compare(other, ours)


def test_packages_are_those_of_windows() -> None:
    needed = environment._needed(["cogrip"])
    assert {"numpy", "mujoco-core", "hidapi", "colorama"} & needed >= {"numpy", "mujoco-core", "hidapi"}
    assert "uvloop" not in needed


def test_complex_mathematics_is_told_from_the_rest() -> None:
    names = ["cabs", "cexpf", "csqrt", "clog", "ctanh", "catan", "cos", "ceil", "copysign", "cbrt", "cosh"]
    assert [name for name in names if re.fullmatch(environment.COMPLEX, name)] == names[:6]
