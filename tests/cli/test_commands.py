"""`cogrip lab` as its users type it: exit codes, output, files; and refusals of all session commands."""

import json
from pathlib import Path

import pytest

from tests.extent import long

CONFIGS = Path(__file__).resolve().parents[2] / "configs"


@pytest.mark.parametrize("seconds", [0.4, long(4)])
@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_config_runs(config, seconds, cogrip):
    summary = cogrip.answer("lab", config, "--set", f"seconds={seconds}")
    assert summary["name"] == config.stem
    assert summary["passive"]
    assert not any(summary[key] for key in ("unstable", "saturated", "left"))
    for user in summary["users"]:
        link = user["link"]
        assert link["sent"] == link["applied"] + link["late"] + link["lost"]


@pytest.mark.long
def test_one_seed_one_summary(cogrip):
    one, same, other = (cogrip.answer(f"lab wan --set seconds=0.75 {more}") for more in ("", "", "--set seed=8"))
    assert one == same != other


def test_the_paper_step_diverges_where_ours_does_not_and_says_so(cogrip):
    stiff = (
        "lab demo --json - --set coupling.stiffness_npm=1e5 --set link.delay_ms=31.25 --set playout.frames=0 --set seconds=2.5 "
        "--set users.0.device=sim:ideal --set users.1.device=sim:ideal"
    )
    assert json.loads(cogrip.out(stiff))["object"]["travel_m"] > 0.02
    out, err = cogrip.texts(f"{stiff} --set coupling.server_step=paper --allow-unstable", code=1)
    assert json.loads(out)["unstable"]
    assert "unstable: the object left the workspace at " in err


def test_a_run_leaves_its_folder(tmp_path, cogrip):
    cogrip.out(f"lab demo --set seconds=1 --runs {tmp_path}")
    (folder,) = tmp_path.iterdir()
    assert {path.name for path in folder.iterdir()} == {
        "summary.json", "settings.json", "report.html", "plots", "server.mcap", "client-anna.mcap", "client-ben.mcap",
    }  # fmt: skip
    again = cogrip.answer("lab", folder / "settings.json")  # a run can be repeated from what it left
    assert again == json.loads((folder / "summary.json").read_text())


REFUSED = {
    "lab demo --set nonsense": "section.key=value",
    "lab demo --set users.0.hand=wave": "wave",
    "lab demo --set 'users.0.hand=csv:none.csv&time=t&x=x'": "none.csv",
    "lab demo --runs /proc/x": "no folder can be made there",
    "serve": "name at least one settings file",
    "serve demo demo": "two rooms are called 'demo'",
    "serve demo --port 99999": "--port 99999 is outside 0 to 65535",
    "join 127.0.0.1:1 --set seed=1": "--config",
    "demo --hands hold --hands hold --hands hold": "--hands is given 3 times",
    "demo --hands 'csv:none.csv&time=t&x=x'": "none.csv",
    "fly": "fly",
    "stability radius demo --set users.0.device_mass_kg=-1": "device_mass_kg: expects a number of at least",
    "stability radius demo --delay-frames -1": "delay of -1 frames each way is out of 0 to 256",
    "stability radius demo --delay-frames nan": "delay of nan frames",
    "stability limit demo --set coupling.stiffness_npm=0": "must have a part above 0",
    "stability region demo --out x --delays-frames 0,zwei": "write numbers with commas",
    "stability region demo --out x --delays-frames 1,1": "stands twice",
    "stability region demo --out x --to-npm 1,2,3": "--to-npm '1,2,3'",
    "stability region demo --out x --to-npm -5": "has no area",
    "stability region demo --out x --grid 5000": "out of 0 to 2000",
    "feel demo --user 2": "users are numbered 0 to 1",
    "figures fig7": "there is no 'fig7'; there are fig4",
    "sweep demo --vary seed=1,2 --measure lifted.radius": "did you mean lifted.spectral_radius",
    "sweep demo --vary seed=1,2 --workers 0": "--workers 0 must be at least 1",
    "sweep demo --vary seed=1,2 --jobs 0": "--workers 0 must be at least 1",
    "sweep demo --vary seed=1,2 --address x:1": "give --cluster ray",
    "compare demo --methods wave,copling": "there is no method 'copling'; did you mean coupling?",
    "compare demo --profiles wify": "there is no profile 'wify'; did you mean wifi?",
    "compare demo --profiles ,": "no profile is named; there are: lan, wifi",
    "compare demo --seeds 0": "at least 1",
    "compare demo --workers 0": "--workers 0 must be at least 1",
    "compare demo --set users.0.device=haply:/dev/ttyACM0": "haply",
    "compare demo --hands 'csv:none.csv&time=t&x=x'": "none.csv",
    "compare demo --out file.txt --methods wave --profiles lan": "is no comparison's folder",
}


@pytest.mark.parametrize("command", REFUSED)
def test_bad_input_is_named_and_nothing_is_left(command, empty_folder, cogrip):
    (empty_folder / "file.txt").touch()
    cogrip.refuses(REFUSED[command], command)
