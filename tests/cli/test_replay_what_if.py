"""`cogrip replay --what-if` as its users type it: exit codes, words, what it leaves."""

import json
import signal
from html import unescape
from pathlib import Path

import pytest

from cogrip.results.reading.records import open_run
from cogrip.sim.laboratory import Laboratory

from tests.cli.command import Cogrip
from tests.cli.spoiled_runs import FILES

LIVE = Path(__file__).resolve().parents[1] / "recordings" / "live"


@pytest.mark.long
def test_another_world_leaves_a_run_and_a_comparison(run: Path, cogrip: Cogrip) -> None:
    said = cogrip.out("replay run --what-if --set coupling.stiffness_npm=300 --runs other")
    (folder,) = Path("other").iterdir()
    assert folder.name.endswith("-pair-what-if")
    left = {path.name for path in folder.iterdir()}
    assert left >= {*FILES, "settings.json", "summary.json", "report.html", "comparison.html"}
    assert json.loads((folder / "settings.json").read_text())["coupling"]["stiffness_npm"] == 300.0
    assert f"comparison: {folder / 'comparison.html'}" in said
    assert "peak force [N]" in said
    for words in ("as recorded", "with coupling.stiffness_npm = 300"):
        assert words in said
        assert words in (folder / "comparison.html").read_text()
    cogrip.texts(f"replay {folder} --verify")


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize(
    ("hands", "device", "hand"),
    [
        ("impedance", "sim:ideal", "recording:run#user=ben"),
        ("positions", "replay:run#user=ben", "hold"),
        ("same", "sim:ideal", "hold"),
    ],
)
def test_how_the_hands_take_part(run: Path, cogrip: Cogrip, hands: str, device: str, hand: str) -> None:
    said = cogrip.out(f"replay run --what-if --hands {hands} --runs other")
    assert "unchanged, in the laboratory" in said
    (folder,) = Path("other").iterdir()
    ben = json.loads((folder / "settings.json").read_text())["users"][1]
    assert (ben["device"], ben["hand"]) == (device, hand)


@pytest.mark.long
@pytest.mark.usefixtures("no_pictures")
def test_beside_a_live_run_stands_what_the_laboratory_changes_by_itself(run: Path, cogrip: Cogrip) -> None:
    said = cogrip.out("replay", LIVE, "--what-if", "--set", "link.delay_ms=5", "--runs", "other")
    for words in ("as recorded", "unchanged, in the laboratory", "with link.delay_ms = 5"):
        assert words in said
    (folder,) = Path("other").iterdir()
    assert open_run(folder / "unchanged").settings() is not None
    assert {path.name for path in LIVE.iterdir()} == {*FILES, "settings.json", "summary.json"}, "nothing is left there"


@pytest.mark.parametrize(("name", "change"), [("run", ""), (LIVE, "link.delay_ms")])
def test_after_an_interruption_runs_are_compared_over_what_all_have(
    run: Path, cogrip: Cogrip, monkeypatch: pytest.MonkeyPatch, name: object, change: str
) -> None:
    """Ctrl-C after 20 frames of the first session: what was not run is said, and nothing stands beside a whole run's total."""
    frames, frame = [], Laboratory.frame

    def counted(laboratory: Laboratory, each_tick: object = None) -> None:
        frames.append(laboratory)
        if len(frames) == 20:
            signal.raise_signal(signal.SIGINT)
        frame(laboratory, each_tick)

    monkeypatch.setattr(Laboratory, "frame", counted)
    changes = ["--set", "link.delay_ms=5"] if change else []
    said = " ".join(cogrip.out("replay", name, "--what-if", *changes, "--runs", "other", code=130).split())
    assert len(frames) == 20
    missing = f", 'with {change} = 5' was not run" if change else ""
    banner = f"nterrupted: 'unchanged, in the laboratory' was cut short{missing}."
    assert f"i{banner}" in said
    assert "All numbers but the length are of the first 0.16 s, which all have" in said
    (folder,) = Path("other").iterdir()
    page = unescape((folder / "comparison.html").read_text())
    assert f"<li>I{banner}</li>" in page
