"""Studies as data sets of BIDS: the numbers of the recordings, nobody named, and no error by the standard's own validator."""

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cogrip.cli.main import main
from cogrip.experiments.study.bids import EVENT_COLUMNS, pseudonyms, without_names
from cogrip.experiments.study.journal import AnswerLine, StudyFolder, read_trials
from cogrip.results.reading.records import open_run

from tests.cli.command import Cogrip
from tests.experiments.studies import parsed, run_in_laboratory

STUDY = """
name = "two at once"
participants = [["Annabel", "Benedikt"], ["Cleo", "Dora"]]
instructions = "Annabel, hold it."
[session]
seconds = 0.4
object.axes = 2
link.delay_ms = 10
users = [{ hand = "reach" }, { hand = "hold" }]
[conditions.soft]
coupling.stiffness_npm = 500.0
[conditions.stiff]
coupling.stiffness_npm = 900.0
[questions.sure]
kind = "likert"
text = "How sure?"
[questions.said]
kind = "text"
text = "What was it like?"
[[blocks]]
name = "one"
ask = ["sure", "said"]
[[blocks.phases]]
name = "prepare"
seconds = 0.1
[[blocks.phases]]
name = "push"
"""
PEOPLE = ("Annabel", "Benedikt", "Cleo", "Dora")
LIMIT_S = 120.0


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("studies") / "two"
    folder: StudyFolder = run_in_laboratory(parsed(STUDY), path, (0, 1))
    line = next(each for each in folder.trials if each.status == "finished")
    folder.add_answer(
        AnswerLine(line.group, "Annabel", line.block, line.place, line.attempt, "said", "Benedikt pulled at me")
    )
    folder.close()
    return path


@pytest.fixture
def cogrip(capsys: pytest.CaptureFixture[str]) -> Cogrip:
    return Cogrip(main, capsys)


@pytest.fixture
def made(study: Path, tmp_path: Path, cogrip: Cogrip) -> Path:
    code, out, said = cogrip("export", study, "--to", "bids", "--out", tmp_path / "bids")
    assert code == 0, said
    assert "4 participants, 8 runs of motion data" in " ".join(out.split())
    return tmp_path / "bids"


def table(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def test_motion_is_that_of_the_recordings(study: Path, made: Path) -> None:
    runs = [run for line in read_trials(study) if line.status == "finished" and line.group == 0 for run in line.runs]
    for number, run in enumerate(runs, 1):
        ticks = open_run(study / "runs" / run).clients["Benedikt"].columns("tick")
        stem = made / "sub-02" / "motion" / f"sub-02_task-twoatonce_tracksys-cogrip_run-{number}"
        channels = table(Path(f"{stem}_channels.tsv"))
        columns = np.genfromtxt(f"{stem}_motion.tsv", delimiter="\t", missing_values="n/a")
        assert columns.shape == (len(ticks["time_s"]), len(channels))
        names = [channel["name"] for channel in channels]
        assert names == [
            "latency", "hand_position_x", "hand_position_y", "hand_velocity_x", "hand_velocity_y", "hand_force_x",
            "hand_force_y", "object_position_x", "object_position_y",
        ]  # fmt: skip
        assert [channel["type"] for channel in channels] == [
            "LATENCY",
            "POS",
            "POS",
            "VEL",
            "VEL",
            "MISC",
            "MISC",
            "POS",
            "POS",
        ]
        fields = [ticks[name] for name in ("position_m", "velocity_mps", "force_n", "object_m")]
        np.testing.assert_array_equal(columns[:, 1:], np.hstack(fields))
        np.testing.assert_array_equal(columns[:, 0], ticks["time_s"] - ticks["time_s"][0])
        said = json.loads(Path(f"{stem}_motion.json").read_text(encoding="utf-8"))
        assert (said["SamplingFrequency"], said["MotionChannelCount"], said["POSChannelCount"]) == (1024, 9, 4)


def test_events_have_the_trial_its_phases_and_its_end(made: Path) -> None:
    for path in made.glob("sub-*/motion/*_events.tsv"):
        rows = table(path)
        assert [*rows[0]] == [*EVENT_COLUMNS]
        assert [row["event"] for row in rows] == ["trial", "phase", "phase", "marker"]
        assert [row["trial_type"] for row in rows[1:]] == ["prepare", "push", "end"]
        assert rows[0]["trial_type"] == rows[0]["condition"] in ("soft", "stiff")
        onsets = [float(row["onset"]) for row in rows]
        assert onsets == sorted(onsets)
        assert float(rows[2]["onset"]) - float(rows[1]["onset"]) == pytest.approx(0.1, abs=0.01)
        assert float(rows[0]["duration"]) == pytest.approx(0.4, abs=0.01)
    told = json.loads((made / "task-twoatonce_events.json").read_text(encoding="utf-8"))
    assert told.keys() == EVENT_COLUMNS.keys()


def test_nobody_is_named_and_nothing_typed_is_told(made: Path) -> None:
    text = "\n".join(f"{path}\n{path.read_text(encoding='utf-8')}" for path in made.rglob("*") if path.is_file())
    for name in PEOPLE:
        assert name not in text.replace(str(made), "")
    assert "pulled at me" not in text
    assert "sub-01, hold it." in text
    people = table(made / "participants.tsv")
    assert [(row["participant_id"], row["group"], row["seat"]) for row in people] == [
        ("sub-01", "1", "0"), ("sub-02", "1", "1"), ("sub-03", "2", "0"), ("sub-04", "2", "1"),
    ]  # fmt: skip
    rows = table(made / "sub-01" / "beh" / "sub-01_task-twoatonce_beh.tsv")
    assert len(rows) == 2
    assert "answer_sure" in rows[0]
    assert "answer_said" not in rows[0]
    assert float(rows[0]["path_m"]) >= 0.0


def test_labels_are_those_of_the_study_s_file_whoever_took_part() -> None:
    assert pseudonyms(parsed(STUDY)) == {name: f"{number:02}" for number, name in enumerate(PEOPLE, 1)}
    assert pseudonyms(parsed(STUDY, participants=[[f"P{n}", f"Q{n}"] for n in range(60)]))["P7"] == "015"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("Anna B. let go", "sub-01 let go"), ("anna  b., P-: go", "sub-01, sub-02: go"), ("go_p-", "go_sub-02"),
        ("annab. and Hannah", "annab. and Hannah"), ("Eva", "sub-03"), ("Evangeline", "Evangeline"),
    ],
)  # fmt: skip
def test_names_are_found_as_people_write_them(text: str, told: str) -> None:
    assert without_names(text, {"Anna  B.": "01", "P-": "02", "Eva": "03"}) == told


def test_nothing_is_overwritten_and_another_folder_is_refused(
    study: Path, made: Path, tmp_path: Path, cogrip: Cogrip
) -> None:
    code, _, said = cogrip("export", study, "--to", "bids", "--out", made)
    assert code == 2
    assert "nothing is overwritten" in " ".join(said.split())
    code, _, said = cogrip("export", tmp_path, "--to", "bids")
    assert code == 2
    assert "is no study's folder" in " ".join(said.split())


def validated(folder: Path) -> tuple[int, list[dict[str, Any]]]:
    """Return exit code and errors of the validator of the standard, which runs on its own and asks no network."""
    program = Path(sys.executable).with_name("bids-validator-deno")
    if not program.exists():
        pytest.skip("bids-validator-deno is not installed")
    command = [str(program), str(folder), "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    if not done.stdout.lstrip().startswith("{"):
        pytest.skip(f"bids-validator-deno does not run here: {done.stderr[-200:]}")
    issues = json.loads(done.stdout)["issues"]["issues"]
    return done.returncode, [each for each in issues if each["severity"] == "error"]


def test_the_validator_of_the_standard_finds_no_error(made: Path) -> None:
    code, errors = validated(made)
    assert errors == []
    assert code == 0


def test_the_validator_finds_what_is_wrong(made: Path, tmp_path: Path) -> None:
    ill = Path(shutil.copytree(made, tmp_path / "ill"))
    stem = "sub-01/motion/sub-01_task-twoatonce_tracksys-cogrip_run-1"
    channels = ill / f"{stem}_channels.tsv"
    channels.write_text(re.sub("POS", "PLACE", channels.read_text(encoding="utf-8"), count=1), encoding="utf-8")
    (ill / f"{stem}_motion.json").write_text("{}")
    (ill / "participants.tsv").write_text("participant_id\tgroup\nsub-09\t1\n")
    code, errors = validated(ill)
    assert code != 0
    assert len({each["code"] for each in errors}) >= 2, errors
