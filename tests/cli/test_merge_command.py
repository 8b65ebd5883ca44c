"""`cogrip merge` as its users type it: exit codes, words, what it leaves."""

import re
from pathlib import Path

import pytest

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import ANNA, BEN, FILES, SERVER, cut


@pytest.fixture
def parts(run: Path) -> list[Path]:
    """The run in three folders, as three machines leave it."""
    folders = [Path(name) for name in ("at the server's", "at anna's", "at ben's")]
    for folder, file in zip(folders, (SERVER, ANNA, BEN), strict=True):
        folder.mkdir()
        (run / file).rename(folder / file)
    (run / "settings.json").rename(folders[0] / "settings.json")
    return folders


def test_merge_says_what_it_did(parts: list[Path], cogrip: Cogrip) -> None:
    said, problems = cogrip.texts("merge", *parts, "--out", "merged")
    lines = (said + problems).splitlines()
    for file, line in zip((ANNA, BEN), lines, strict=False):
        assert re.fullmatch(
            rf"{file}: [+-]\d+\.\d{{3}} ms to the server's clock, by datagrams; there are no clock anchors "
            r"\(datagrams bound it to ±\d+\.\d ms\)",
            line,
        )
    assert lines[2:] == ["merged: merged; see `cogrip report merged`"]
    assert {path.name for path in Path("merged").iterdir()} == {*FILES, "clocks.json", "settings.json"}
    assert cogrip("replay", "merged", "--verify")[0] == 0


@pytest.mark.usefixtures("no_pictures")
def test_a_merged_run_is_a_run_like_any_other(parts: list[Path], cogrip: Cogrip) -> None:
    assert cogrip("merge", *parts, "--out", "merged")[0] == 0
    assert cogrip("replay", "merged", "--what-if", "--set", "seed=3", "--runs", "other")[0] == 0
    cut(Path("merged") / ANNA)
    assert "saved in merged/client-anna.recovered.mcap" in cogrip.err("replay", "merged", "--verify", code=0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("at anna's", "--out", "new"), "name at least two folders, the server's and a client's"),
        (("at anna's", "at ben's", "--out", "new"), "a run has one server, and here is none"),
        (("at the server's", "nowhere", "--out", "new"), "nowhere: there is no such run"),
        (("at the server's", "at anna's", "--out", "at ben's"), "--out at ben's exists already; name a new folder"),
        (("at the server's", "at anna's", "--out", "file.txt/new"), "Not a directory"),
        (("at the server's", "at anna's"), "--out"),
    ],
)
def test_what_cannot_be_merged_is_named_and_nothing_is_left(
    parts: list[Path], cogrip: Cogrip, arguments: tuple[str, ...], words: str
) -> None:
    Path("file.txt").write_text("not a recording")
    cogrip.refuses(words, "merge", *arguments)
