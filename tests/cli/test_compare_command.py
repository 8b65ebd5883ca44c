"""`compare` as its users type it."""

import json
from pathlib import Path

import pytest

from cogrip.experiments.methods.tasks import TASKS

from tests.cli.command import Cogrip

PAIR = """
name = "pair"
seconds = 2.0
[rates]
device_hz = 512
[coupling]
stiffness_npm = 4000.0
impedance_nspm = 15.0
[link]
delay_ms = 20.0
[[users]]
name = "anna"
[[users]]
name = "ben"
hand = "hold"
"""


@pytest.fixture
def config(empty_folder: Path) -> Path:
    path = empty_folder / "pair.toml"
    path.write_text(PAIR)
    return path


@pytest.mark.usefixtures("no_probes")
def test_one_table_and_a_folder(config: Path, cogrip: Cogrip) -> None:
    """Recorded hands, the settings' own link, and a baseline that fails: that is a result, not a failure."""
    hand = config.with_name("hand.csv")
    hand.write_text("t_s,x_m\n" + "".join(f"{0.05 * k},{0.002 * (k % 4)}\n" for k in range(40)))
    command = ["compare", config, "--methods", "wave,coupling", "--profiles", "own", "--seeds", "1", "--workers", "1"]
    command += ["--hands", f"csv:{hand}&time=t_s&x=x_m"]
    out, err = cogrip.texts(*command, "--json", "answer.json")
    lines = [line.split() for line in out.splitlines()]
    table = [line for line in lines if line[:1] in (["clean"], ["own"], ["wave"], ["coupling"])]
    assert [line[0] for line in table[:6]] == ["clean", "wave", "coupling", "own", "wave", "coupling"]
    assert table[4][1].startswith("stable")  # what the sampled dampers of 512 Hz leak is not its doing
    assert table[5][1] in ("diverged", "oscillates")
    assert table[5][2].startswith("1/1")
    assert "2 of 4 sessions" in err
    (folder,) = (config.parent / "runs").iterdir()
    assert folder.name.endswith("-compare-pair")
    assert f"report: runs/{folder.name}/report.html" in out
    found = json.loads(Path("answer.json").read_text())
    assert found["run"] == found["sessions"] == 4
    assert found["asked"]["settings"]["users"][0]["hand"].startswith("csv:")
    err = cogrip.err(*command, "--out", folder, "--set", "seconds=3")
    assert "holds another comparison (other settings, rest_s)" in err


@pytest.mark.usefixtures("no_pictures", "no_probes", "no_workers")
def test_ours_has_to_hold(config: Path, cogrip: Cogrip) -> None:
    """Two people who throw the object out of the room."""
    pushes = ["--hands", "push&force_n=8", "--hands", "push&force_n=8"]
    command = ["compare", config, "--methods", "wave", "--profiles", "clean", "--seeds", "1", "--workers", "1", *pushes]
    command += ["--set", "users.0.device=sim:ideal", "--set", "users.1.device=sim:ideal"]
    out, err = cogrip.texts(*command, code=1)
    assert "diverged 1/1 at" in out
    assert "cogrip's own method failed: wave on clean diverged" in err
    command[command.index("wave")] = "coupling"
    assert "diverged 1/1 at" in cogrip.out(*command), "that of a baseline is a result"


@pytest.mark.usefixtures("no_probes")
@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--task", "pul"], "there is no task 'pul'; did you mean pull? there are: pull, opposed, together, rest"),
        (["--task", "pull", "--hands", "hold"], "--task pull says what both hands do; leave --hands out"),
    ],
)  # fmt: skip
def test_a_task_that_cannot_be_is_refused_in_a_line(
    config: Path, cogrip: Cogrip, arguments: list[str], why: str
) -> None:
    assert why in cogrip.err("compare", config, *arguments)


@pytest.mark.usefixtures("no_pictures", "no_probes", "no_workers")
def test_a_task_says_what_both_hands_do(config: Path, cogrip: Cogrip) -> None:
    command = ["compare", config, "--task", "limp", "--methods", "partner", "--profiles", "own", "--seeds", "1"]
    cogrip.texts(*command, "--workers", "1", "--json", "answer.json")
    users = json.loads(Path("answer.json").read_text())["asked"]["settings"]["users"]
    assert tuple(user["hand"] for user in users) == TASKS["limp"].hands
