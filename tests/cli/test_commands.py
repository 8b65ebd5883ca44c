"""`cogrip lab` as its users type it: exit codes, output, files; and refusals of all session commands."""

import json
from pathlib import Path

import pytest

from cogrip.cli.main import main

from tests.extent import long

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = str(CONFIGS / "demo.toml")


def lab_json(capsys, *arguments: str) -> tuple[int, dict]:
    code = main(["lab", *arguments, "--json", "-"])
    return code, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("seconds", [1.5, long(4)])
@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_config_runs(config, seconds, capsys):
    code, summary = lab_json(capsys, str(config), "--set", f"seconds={seconds}")
    assert summary["name"] == config.stem
    assert summary["passive"]
    assert not summary["diverged"]
    assert code == 0
    for user in summary["users"]:
        link = user["link"]
        assert link["sent"] == link["applied"] + link["late"] + link["lost"]


def test_one_seed_one_summary(capsys):
    outputs = []
    for _ in range(2):
        main(["lab", str(CONFIGS / "wan.toml"), "--json", "-", "--set", "seconds=3"])
        outputs.append(capsys.readouterr().out)
    assert outputs[0] == outputs[1]
    main(["lab", str(CONFIGS / "wan.toml"), "--json", "-", "--set", "seconds=3", "--set", "seed=8"])
    assert capsys.readouterr().out != outputs[0]


def test_the_paper_step_diverges_where_ours_does_not(capsys):
    stiff = [
        "--set", "coupling.stiffness_npm=1e5", "--set", "link.delay_ms=31.25", "--set", "playout.frames=0",
        "--set", "seconds=4", "--set", "users.0.device=sim:ideal", "--set", "users.1.device=sim:ideal",
    ]  # fmt: skip
    code, ours = lab_json(capsys, DEMO, *stiff)
    assert code == 0
    assert ours["object"]["travel_m"] > 0.02
    code, paper = lab_json(capsys, DEMO, *stiff, "--set", "coupling.server_step=paper", "--allow-unstable")
    assert code == 1
    assert paper["diverged"]


def test_a_run_leaves_its_folder(tmp_path, capsys):
    assert main(["lab", DEMO, "--set", "seconds=2", "--runs", str(tmp_path)]) == 0
    (folder,) = tmp_path.iterdir()
    assert {path.name for path in folder.iterdir()} == {
        "summary.json", "settings.json", "report.html", "plots", "server.mcap", "client-anna.mcap", "client-ben.mcap",
    }  # fmt: skip
    capsys.readouterr()
    again = folder / "settings.json"  # a run can be repeated from what it left
    code, summary = lab_json(capsys, str(again))
    assert code == 0
    assert summary == json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lab", "configs/dmo.toml"], "there is no such file"),
        (["lab", DEMO, "--set", "coupling.stifness_npm=1"], "did you mean coupling.stiffness_npm?"),
        (["lab", DEMO, "--set", "rates.device_hz=1000"], "not a whole multiple of rates.network_hz = 128"),
        (
            ["lab", DEMO, "--set", "coupling.stiffness_npm=-1"],
            "stiffness_npm: expects a number of at least 0, in N/m; got -1",
        ),
        (["lab", DEMO, "--set", "coupling.kind=warp"], 'kind: expects "wave", "coupling" or "tdpa"; got \'warp\''),
        (["lab", DEMO, "--set", "users.7.name=x"], "there is no user number 7"),
        (["lab", DEMO, "--set", "nonsense"], "section.key=value"),
        (["lab", DEMO, "--set", "coupling.compensate=true"], "An impedance above"),
        (["lab", DEMO, "--set", "users.0.hand=wave"], "wave"),
        (["lab", DEMO, "--set", "users.0.hand=csv:none.csv&time=t&x=x"], "none.csv"),
        (["serve"], "name at least one settings file"),
        (["serve", DEMO, DEMO], "two rooms are called 'demo'"),
        (["serve", DEMO, "--port", "99999"], "--port 99999 is outside 0 to 65535"),
        (["lab", DEMO, "--runs", "/proc/x"], "no folder can be made there"),
        (["join", "nowhere:port"], "HOST:PORT"),
        (["join", "127.0.0.1:1", "--device", "sim:phantm"], "sim:phantm"),
        (["join", "127.0.0.1:1", "--set", "seed=1"], "--config"),
        (["demo", "--hands", "hold", "--hands", "hold", "--hands", "hold"], "--hands is given 3 times"),
        (["demo", "--hands", "csv:none.csv&time=t&x=x"], "none.csv"),
        (["fly"], "fly"),
    ],
)
def test_bad_input_is_named_and_nothing_is_left(arguments, words, empty_folder, cogrip):
    code, out, err = cogrip(*arguments)
    assert code == 2
    assert words in err + out
    assert list(empty_folder.iterdir()) == []
