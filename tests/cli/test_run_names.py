"""Runs by the name that `cogrip runs` lists, in every command that takes a run."""

import shutil
from pathlib import Path

import pytest

from cogrip.cli.session import view
from cogrip.client.io.paths import JoinError

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import cut

NAME, OTHER = "20260101-120000-pair", "20260101-130000-pair"
WAYS = ["replay {} --verify", "export {} --to csv --out tables", "report {}", "view {} --out page.html", "recover {}"]


@pytest.fixture
def runs(recorded: Path, empty_folder: Path) -> Path:
    """Return the folder of two runs in the current one."""
    for name in (NAME, OTHER):
        shutil.copytree(recorded, empty_folder / "runs" / name)
    return Path("runs")


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.usefixtures("no_pictures")
def test_a_name_is_looked_for_in_runs_or_the_folder_that_is_given(runs: Path, cogrip: Cogrip, way: str) -> None:
    assert NAME in cogrip.out("runs")
    cogrip.texts(way.format(NAME))
    runs.rename("others")
    shutil.rmtree("tables", ignore_errors=True)
    cogrip.texts(way.format(NAME) + " --runs others")


@pytest.mark.parametrize("way", WAYS)
def test_a_name_that_is_nowhere_is_told_with_the_nearest(runs: Path, cogrip: Cogrip, way: str) -> None:
    words = "there is no such run, neither here nor in runs; did you mean"
    for given, near in ((NAME[:-1], NAME), (f"runs/{NAME[:-1]}", NAME), ("pair", OTHER)):  # the newest of both
        cogrip.refuses(f"{given}: {words} {near}? `cogrip runs` lists them", way.format(given))
    cogrip.refuses("zzz: there is no such run, neither here nor in runs; `cogrip runs`", way.format("zzz"))
    cogrip.refuses("nor in others; `cogrip runs others` lists them", way.format(NAME) + " --runs others")


@pytest.mark.usefixtures("no_pictures")
def test_several_are_compared_and_parts_are_merged_by_name(runs: Path, cogrip: Cogrip) -> None:
    cogrip.texts("report", NAME, OTHER)
    cogrip.refuses("is named twice", "report", NAME, runs / NAME)
    for file in (runs / NAME).glob("client-*.mcap"):
        (runs / "anna").mkdir(exist_ok=True)
        file.rename(runs / "anna" / file.name)
    cogrip.texts("merge", NAME, "anna", "--out", "whole")
    cogrip.texts("replay", "whole", "--verify")


def test_a_path_goes_before_a_name(runs: Path, cogrip: Cogrip) -> None:
    shutil.copytree(runs / NAME, OTHER)
    cut(Path(OTHER) / "server.mcap")
    cogrip.texts("recover", OTHER)
    assert (Path(OTHER) / "server.recovered.mcap").exists()
    assert not (runs / OTHER / "server.recovered.mcap").exists()


def test_what_is_neither_a_run_nor_a_server_is_told_as_such(
    runs: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unknown(host: str, port: int) -> None:
        raise JoinError(f"{host}: Name or service not known; check the server's name")

    monkeypatch.setattr(view, "find", unknown)
    words = "is no server that is known here, and no run, neither here nor in runs;"
    cogrip.refuses(f"{NAME[:-1]}: {words} did you mean {NAME}? `cogrip runs` lists them", "view", NAME[:-1])
    cogrip.refuses(f"zzz: {words} `cogrip runs` lists them", "view", "zzz")
