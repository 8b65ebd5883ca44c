"""The report of a run: complete, self-contained and escaped, with a sentence for everything that is missing."""

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from cogrip.protocol.recording.reader import RecordedMessage
from cogrip.protocol.recording.records import Tick
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.room import resolve
from cogrip.results.plots import registry
from cogrip.results.reading.folder import SERVER_RECORDING, client_recording
from cogrip.results.report.page import write_report
from cogrip.results.report.tables import settings_tables
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.extent import long
from tests.recording_files import rewrite
from tests.results.reported_runs import SETTINGS, Page, assert_self_contained, page_of, printed, text_of

pytestmark = pytest.mark.usefixtures("blank")
SCRIPT = "<script>alert(1)</script>"
PLOTS_IN_VIRTUAL_TIME = {"positions", "forces", "waves", "energy", "link", "coherence"}


def test_report_and_plots_are_left_in_the_folder(folder: Path) -> None:
    report = write_report(folder)
    assert report == folder / "report.html"
    plots = {path.stem: path.read_bytes() for path in (folder / "plots").glob("*.png")}
    assert set(plots) == PLOTS_IN_VIRTUAL_TIME
    assert all(picture.startswith(b"\x89PNG") for picture in plots.values())
    text = report.read_text(encoding="utf-8")
    assert "Passive" in text
    assert "Not drawn: in virtual time no tick is late" in text
    assert_self_contained(text, pictures=len(plots))
    assert page_of(folder) == text, "the same run gives the same report"


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    "more",
    [
        {"object": {"axes": 3}, "users": [{"name": name} for name in "ab"]},
        {"object": {"kind": "wall"}, "users": [{"name": "anna", "hand": "push"}]},
        {"coupling": {"kind": "coupling", "stiffness_npm": 2000.0}},
        {"users": [{"name": f"person {seat}"} for seat in range(7)], "seconds": 0.3},
    ],
    ids=["three axes", "wall", "virtual coupling", "a crowd for a moment"],
)
def test_every_kind_of_run_has_a_report(tmp_path: Path, more: dict[str, Any]) -> None:
    run_laboratory(resolve({**SETTINGS, "seconds": 0.6, **more}), tmp_path)
    assert "data:image/png" in page_of(tmp_path)
    assert (tmp_path / "plots" / "waves.png").exists() == ("coupling" not in more)


def test_live_loops_are_drawn(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "PLOTS", [plot for plot in registry.PLOTS if plot.name == "loops"])
    late_us = iter(np.geomspace(1.0, 900.0, 2048).round().astype(int).tolist())

    def of_a_live_loop(kind: str, message: RecordedMessage) -> bytes:
        if kind != "tick":
            return message.payload
        tick = msgspec.json.decode(message.payload, type=Tick)
        return encode(msgspec.structs.replace(tick, late_us=next(late_us), work_us=40))

    rewrite(folder / client_recording("anna"), of_a_live_loop)
    write_report(folder)
    assert (folder / "plots" / "loops.png").exists()


def test_settings_that_are_not_the_default_are_marked(folder: Path) -> None:
    text = text_of(folder)
    assert '<tr><th>tank_mj</th><td class="changed">0.5</td></tr>' in text
    assert "<tr><th>redundancy</th><td>8</td></tr>" in text


def test_a_long_reason_is_shown_whole(folder: Path, summary: dict[str, Any]) -> None:
    summary["users"][0] |= {"state": "fault", "reason": "because " * 30}
    (folder / "summary.json").write_text(json.dumps(summary))
    assert text_of(folder).count("because") == 60  # once in the verdict, once in the table


def test_every_text_from_outside_is_escaped(folder: Path, summary: dict[str, Any]) -> None:
    settings = json.loads((folder / "settings.json").read_text())
    summary["name"] = settings["name"] = settings["object"]["kind"] = SCRIPT
    settings[SCRIPT] = {SCRIPT: SCRIPT}
    summary["users"][0] |= {"name": SCRIPT, "state": "fault", "reason": SCRIPT, "peak_force_n": SCRIPT}
    settings["users"][0] |= {"name": SCRIPT, SCRIPT: SCRIPT}
    summary["object"]["position_m"] = [SCRIPT]
    summary["server"]["dropped"] = {SCRIPT: SCRIPT}
    (folder / "summary.json").write_text(json.dumps(summary))
    (folder / "settings.json").write_text(json.dumps(settings))
    text = text_of(folder)
    assert "script" not in {tag for tag, _ in Page(text).tags}
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 8
    assert SCRIPT[:8] in printed(summary)


def test_markup_and_tex_in_names_are_only_text(folder: Path) -> None:
    """Nothing forbids them to whoever writes the files by hand; matplotlib and rich have languages of their own."""
    name = "[red]_$x^$"
    for file in ("summary.json", "settings.json"):
        path = folder / file
        path.write_text(path.read_text().replace("anna", name))
    (folder / client_recording("anna")).unlink()
    assert name in page_of(folder)
    assert name in printed(json.loads((folder / "summary.json").read_text()))


@pytest.mark.sample(2)
@pytest.mark.parametrize(
    ("missing", "said", "plots"),
    [
        long({SERVER_RECORDING}, "server.mcap is not here", PLOTS_IN_VIRTUAL_TIME),
        ({client_recording("ben")}, "client-ben.mcap is not here", PLOTS_IN_VIRTUAL_TIME - {"coherence"}),
        (
            {client_recording("ben"), client_recording("anna")},
            "no client&#39;s trace",
            {"positions", "forces", "energy", "link"},
        ),
        ({client_recording("ben"), client_recording("anna"), SERVER_RECORDING}, "no trace is here", set()),
        ({"summary.json"}, "There is no summary of this run", PLOTS_IN_VIRTUAL_TIME),
        long({"settings.json"}, "The settings are not known", PLOTS_IN_VIRTUAL_TIME),
        long({"summary.json", "settings.json"}, "cut short", PLOTS_IN_VIRTUAL_TIME),
        (
            {"summary.json", "settings.json", client_recording("ben"), client_recording("anna")},
            "cut short",
            {"positions"},
        ),
    ],
)
def test_what_is_missing_is_said(folder: Path, missing: set[str], said: str, plots: set[str]) -> None:
    (folder / "plots").mkdir()
    for name in PLOTS_IN_VIRTUAL_TIME:
        (folder / "plots" / f"{name}.png").touch()  # of an earlier report: must not outlive what it was drawn from
    for name in missing:
        (folder / name).unlink()
    assert said in page_of(folder)
    assert {path.stem for path in (folder / "plots").glob("*.png")} == plots


def test_folder_of_no_run(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="name the folder of a run"):
        write_report(tmp_path)


def test_damaged_json_is_said(folder: Path) -> None:
    (folder / "summary.json").write_text("{")
    (folder / "settings.json").write_text("[]")
    text = text_of(folder)
    assert "summary.json is not readable" in text
    assert "settings.json holds no table" in text


def without(value: Any) -> Any:
    """Return the same keys, with null in place of every value."""
    if isinstance(value, dict):
        return {key: without(inner) for key, inner in value.items()}
    return [without(inner) for inner in value] if isinstance(value, list) else None


def test_nulls_are_not_known(folder: Path, summary: dict[str, Any]) -> None:
    summary = without(summary)
    (folder / "summary.json").write_text(json.dumps(summary))
    text = text_of(folder)
    assert "not known" in text
    assert "reported no account" in text
    assert ">None<" not in text
    assert "None" not in printed(summary)


def test_a_setting_that_nobody_wrote_and_that_is_empty_has_no_row() -> None:
    settings = {
        "seconds": 10.0,
        "object": {"kind": "cube", "file": ""},
        "users": [{"name": "a", "tool": "", "device": "sim:ideal"}],
    }
    tables = settings_tables(settings)
    assert not isinstance(tables, str)
    shown = {row.label for table in (*tables.sections, tables.users) for row in table.rows if not isinstance(row, str)}
    assert {"seconds", "kind", "device"} <= shown
    assert not {"file", "tool"} & shown
