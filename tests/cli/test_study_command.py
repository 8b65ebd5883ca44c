"""`cogrip study` and `cogrip table`: whole studies in virtual time, what is left, what is refused."""

import csv
from pathlib import Path
from typing import Any

import pytest

from cogrip.cli.study import study_source

from tests.cli.command import Cogrip
from tests.experiments.studies import SHIPPED

pytestmark = pytest.mark.usefixtures("empty_folder")

STUDY = """
name = "two walls"
participants = ["P01", "P02"]
[session]
seconds = 0.25
object.kind = "wall"
[[session.users]]
device = "sim:ideal"
hand = "push"
[conditions.soft]
coupling.stiffness_npm = 300.0
[conditions.stiff]
coupling.stiffness_npm = 900.0
[questions.sure]
kind = "likert"
text = "How sure?"
[[blocks]]
name = "walls"
order = "latin"
ask = ["sure"]
"""
EFFORT = "[questions.load_effort]\nkind = 'text'\ntext = 'Why?'"
FILE = Path("study.toml")
FOLDER = Path("studies/two+walls")


def write(text: str = STUDY, **replaced: str) -> Path:
    for old, new in replaced.items():
        assert old in text
        text = text.replace(old, new)
    FILE.write_text(text)
    return FILE


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_study_leaves_a_folder_a_tidy_table_and_figures(cogrip: Cogrip) -> None:
    assert "4 trials finished, 4 of them now" in cogrip.err("study", write(), code=0)
    runs = sorted(path.name for path in (FOLDER / "runs").iterdir())
    assert runs == ["01-001-walls-1", "01-002-walls-1", "02-001-walls-1", "02-002-walls-1"]
    assert {"settings.json", "summary.json", "server.mcap", "client-P01.mcap"} <= {
        path.name for path in (FOLDER / "runs" / runs[0]).iterdir()
    }
    assert "figures/mean_force_n.png" in cogrip.out("table", FOLDER, "--to", "csv", "--figures")
    found = rows(FOLDER / "table.csv")
    assert [(row["participant"], row["condition"]) for row in found] == [
        ("P01", "soft"), ("P01", "stiff"), ("P02", "stiff"), ("P02", "soft"),
    ]  # fmt: skip
    assert [row["coupling.stiffness_npm"] for row in found] == ["300.0", "900.0", "900.0", "300.0"]
    assert all(1 <= float(row["answer_sure"]) <= 7 for row in found)
    assert all(float(row["mean_force_n"]) > 0.1 and row["completion_s"] == "" for row in found)
    cogrip.refuses("exists, and nothing is overwritten", "table", FOLDER, "--to", "csv")


def test_table_is_the_same_in_parquet_with_units(cogrip: Cogrip) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    cogrip.texts("study", write(), "--people", "P01")
    cogrip.texts("table", FOLDER, "--to", "csv")
    cogrip.texts("table", FOLDER, "--to", "parquet")
    table = parquet.read_table(FOLDER / "table.parquet")
    plain = rows(FOLDER / "table.csv")
    assert table.column_names == list(plain[0])
    assert [repr(value) for value in table["path_m"].to_pylist()] == [row["path_m"] for row in plain]
    assert table.schema.field("mean_force_n").metadata == {b"unit": b"N"}


def test_same_command_goes_on_and_takes_only_the_people_of_today(cogrip: Cogrip) -> None:
    _, err = cogrip.texts("study", write(), "--people", "P02")
    assert "2 trials finished, 2 of them now" in err
    _, err = cogrip.texts("study", FILE)
    assert f"over already, in {FOLDER}: 2 trials" in err
    assert "4 trials finished, 2 of them now" in err
    write(STUDY, **{"300.0": "310.0"})
    cogrip.refuses("holds another study (other study.conditions.soft.coupling.stiffness_npm)", "study", FILE)


def test_files_that_a_study_names_are_beside_it() -> None:
    file = Path("sub") / FILE
    file.parent.mkdir()
    scene = '"scene"\nobject.file = "wall.xml"\nobject.axes = 3'
    file.write_text(write(STUDY, **{'"wall"': scene}).read_text())
    shipped_scene, _ = study_source.load_study(file, live=False, allow_unstable=True)
    assert Path(shipped_scene.session["object"]["file"]).is_file()
    file.with_name("wall.xml").write_text(Path(shipped_scene.session["object"]["file"]).read_text())
    own_scene, _ = study_source.load_study(file, live=False, allow_unstable=True)
    assert own_scene.session["object"]["file"] == str(file.with_name("wall.xml").absolute())


def test_simulated_and_live_trials_do_not_share_a_folder(cogrip: Cogrip) -> None:
    """A rehearsal does not stand in for people, nor do simulated participants add to what people did."""
    cogrip.texts("study", write(), "--people", "P01")
    before = (FOLDER / "trials.jsonl").read_bytes()
    refused = f"{FOLDER} holds simulated trials, and these are live; name another folder by --out"
    cogrip.refuses(refused, "study", FILE, "--live", "--people", "P01")
    cogrip.texts("table", FOLDER, "--to", "csv")
    assert {row["mode"] for row in rows(FOLDER / "table.csv")} == {"simulated"}
    (FOLDER / "trials.jsonl").write_bytes(
        before.replace(b'"utc"', b'"mode":"live","utc"').replace(b"}\n", b',"mode":"live"}\n')
    )
    cogrip.refuses("holds live trials, and these are simulated", "study", FILE)


def test_studies_that_come_with_cogrip_go_by_their_name(monkeypatch: pytest.MonkeyPatch, cogrip: Cogrip) -> None:
    assert (
        study_source.shipped_studies()
        == sorted(path.stem for path in SHIPPED.glob("*.toml"))
        == ["delay", "fitts", "force_fields", "stiffness"]
    )
    cogrip.refuses(
        "there is no such file; give a study's file, or one of: delay, fitts, force_fields, stiffness",
        "study",
        "nothing",
    )
    cogrip.refuses("--people P09: there is no such participant", "study", "fitts", "--people", "P09")
    cogrip.refuses("--remote is for live sessions", "study", "fitts", "--remote", "P01")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({'name = "walls"': 'name = "walls"\norders = 1'}, "blocks.0.orders: there is no such setting; did you mean"),
        ({'order = "latin"': 'order = "latn"'}, "blocks.0.order"),
        ({'["sure"]': '["shure"]'}, "blocks.walls: there is no question 'shure'; there is: sure"),
        ({'order = "latin"': 'conditions = ["hard"]'}, "there is no condition 'hard'; there is: soft, stiff"),
        ({'["P01", "P02"]': '[["P01", "P02"]]'}, "a group of 2 (P01, P02), and the session has 1 users"),
        ({'["P01", "P02"]': '["P01", "P01"]'}, "participants: P01 is named twice"),
        ({"stiffness_npm = 300.0": "stifness_npm = 300.0"}, "did you mean coupling.stiffness_npm?"),
        ({"seconds = 0.25": "seconds = 0.25\nfoo = 1"}, "foo: there is no such setting"),
        ({'kind = "likert"': 'kind = "choice"'}, "questions.sure: a choice needs two different choices"),
        ({'order = "latin"': 'order = "staircase"'}, "go together"),
        ({'name = "two walls"': 'name = "two walls"\nend = "goal"'}, 'end = "goal", and there is none; give goal.place_m'),
        ({"[questions.sure]": "[goal]\nplace_m = [0.1]\n[questions.sure]"}, "goal.place_m and goal.within_m go together"),
        ({'device = "sim:ideal"': 'device = "hid:woodenhaptics"'}, "is hardware"),
        ({'hand = "push"': 'hand = "shove"'}, "shove"),
        ({'"wall"': '"cub"'}, "study.toml: conditions.soft: object.kind: there is no world"),
        ({"= 900.0": '= 900.0\nlink.trace = "none.csv"'}, "study.toml: conditions.stiff: link.trace: "),
        ({"[conditions.stiff]": "[simulated]\nspread.delay_s = 0.1\n[conditions.stiff]"}, "simulated.spread.delay_s: no hand"),
        ({"= 300.0": "= 300.0\nseed = 3"}, "conditions.soft: seed is the study's own; leave it out"),
        ({'["sure"]': '["sure"]\nask_after = ["sure"]'}, "'sure' is in ask and in ask_after"),
        ({"[questions.sure]": f"[questions.load]\nkind = 'tlx'\n{EFFORT}\n[questions.sure]"}, "load_effort is named twice"),
        ({"participants": "participant"}, "participants"),
        ({"[conditions.soft]": "[conditions.soft"}, "not valid TOML"),
    ],
)  # fmt: skip
def test_studies_that_cannot_be_run_are_refused_in_one_line(
    changes: dict[str, str], words: str, cogrip: Cogrip
) -> None:
    cogrip.refuses(words, "study", write(STUDY, **changes))


def test_table_of_what_is_no_study_is_refused(cogrip: Cogrip) -> None:
    cogrip.refuses("is no study's folder", "table", "nowhere", "--to", "csv")
    write()
    cogrip.texts("study", FILE, "--people", "P01")
    broken = next((FOLDER / "runs").iterdir())
    (broken / "client-P01.mcap").unlink()
    _, err = cogrip.texts("table", FOLDER, "--to", "csv")
    assert f"warning: {broken} holds no recording of P01" in err
    found: list[dict[str, Any]] = list(rows(FOLDER / "table.csv"))
    assert [row["path_m"] == "" for row in found] == [row["run"] == broken.name for row in found]


def test_warnings_and_refusals_of_settings_name_all_their_conditions(cogrip: Cogrip) -> None:
    study = """
name = "carried"
participants = ["P01"]
[session]
seconds = 0.05
[[session.users]]
device = "sim:ideal"
[conditions.light]
coupling.impedance_nspm = 5.0
[conditions.heavy]
coupling.impedance_nspm = 90.0
[conditions.again]
coupling.impedance_nspm = 90.0
[[blocks]]
name = "b"
"""
    path = write(study)
    assert "conditions.heavy, conditions.again: refused: P01: b = 90 N s/m" in cogrip.err(
        "study", path, "--out", "refused"
    )
    _, said = cogrip.texts("study", path, "--allow-unstable", "--out", "all")
    warned = [line for line in said.splitlines() if line.startswith("warning: ") and "b = 90 N s/m is more" in line]
    assert len(warned) == 1
    assert warned[0].startswith("warning: conditions.heavy, conditions.again: P01: ")
