"""`cogrip lab` as its users type it: exit codes, output, files; and refusals of all session commands."""

import json
from pathlib import Path

import pytest

from tests.extent import long

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
DEMO = str(CONFIGS / "demo.toml")


@pytest.mark.parametrize("seconds", [0.4, long(4)])
@pytest.mark.parametrize("config", sorted(CONFIGS.glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_config_runs(config, seconds, cogrip):
    summary = cogrip.answer("lab", config, "--set", f"seconds={seconds}")
    assert summary["name"] == config.stem
    assert summary["passive"]
    assert not summary["diverged"]
    for user in summary["users"]:
        link = user["link"]
        assert link["sent"] == link["applied"] + link["late"] + link["lost"]


@pytest.mark.long
def test_one_seed_one_summary(cogrip):
    seeds = ((), (), ("--set", "seed=8"))
    one, same, other = (cogrip.answer("lab", CONFIGS / "wan.toml", "--set", "seconds=0.75", *more) for more in seeds)
    assert one == same != other


def test_the_paper_step_diverges_where_ours_does_not(cogrip):
    stiff = [
        "--set", "coupling.stiffness_npm=1e5", "--set", "link.delay_ms=31.25", "--set", "playout.frames=0",
        "--set", "seconds=2.5", "--set", "users.0.device=sim:ideal", "--set", "users.1.device=sim:ideal",
    ]  # fmt: skip
    ours = cogrip.answer("lab", DEMO, *stiff)
    assert ours["object"]["travel_m"] > 0.02
    paper = cogrip.answer("lab", DEMO, *stiff, "--set", "coupling.server_step=paper", "--allow-unstable", code=1)
    assert paper["diverged"]


def test_a_run_leaves_its_folder(tmp_path, cogrip):
    cogrip.out("lab", DEMO, "--set", "seconds=1", "--runs", tmp_path)
    (folder,) = tmp_path.iterdir()
    assert {path.name for path in folder.iterdir()} == {
        "summary.json", "settings.json", "report.html", "plots", "server.mcap", "client-anna.mcap", "client-ben.mcap",
    }  # fmt: skip
    again = cogrip.answer("lab", folder / "settings.json")  # a run can be repeated from what it left
    assert again == json.loads((folder / "summary.json").read_text())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["lab", "configs/dmo.toml"], "there is no such file"),
        (["lab", DEMO, "--set", "coupling.stifness_npm=1"], "did you mean coupling.stiffness_npm?"),
        (["lab", DEMO, "--set", "rates.device_hz=1000"], "not a whole multiple of rates.network_hz = 128"),
        (
            ["lab", DEMO, "--set", "coupling.stiffness_npm=-1"],
            "stiffness_npm: expects a number of at least 0, in N/m; got",
        ),
        (
            ["lab", DEMO, "--set", "coupling.kind=warp"],
            'kind: expects "wave", "local", "coupling" or "tdpa"; got \'warp\'',
        ),
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
        (["join", "127.0.0.1:1", "--set", "seed=1"], "--config"),
        (["demo", "--hands", "hold", "--hands", "hold", "--hands", "hold"], "--hands is given 3 times"),
        (["demo", "--hands", "csv:none.csv&time=t&x=x"], "none.csv"),
        (["fly"], "fly"),
    ],
)
def test_bad_input_is_named_and_nothing_is_left(arguments, words, empty_folder, cogrip):
    cogrip.refuses(words, *arguments)
