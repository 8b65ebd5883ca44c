"""`cogrip set` and a terminal's `set` as their users have them: real processes, real sockets."""

import signal
import sys
from pathlib import Path

import pytest

from tests.live.test_live_sessions import replayed, summary_in

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")

CONFIG = """
name = "demo"
[object]
axes = 3
[[users]]
name = "anna"
device = "sim:phantom?hand=hold"
"""


def test_a_change_is_taken_told_refused_and_replayed(run, serve, tmp_path):
    folder = tmp_path / "state"
    config = tmp_path / "demo.toml"
    config.write_text(CONFIG)
    server, port = serve(config, "--state", folder)
    anna = run("join", f"127.0.0.1:{port}", "--name", "anna", "--runs", tmp_path / "anna", "--no-report")
    anna.hear("anna holds cube")

    def ordered(code: int, words: str, *arguments: str) -> None:
        process = run("set", *arguments, "--state", folder)
        assert process.end() == code, process.said
        assert words in process.said

    ordered(0, "anna: position_scale=3 force_scale=0.5 ", "anna", "position_scale=3", "force_scale=0.5")
    anna.hear("the administrator has set your hand: position_scale=3 ")
    ordered(1, "did not take gravity_compensation", "anna", "gravity_compensation=on")
    ordered(1, "nobody seated here is 'ben'; there is: anna", "ben", "position_scale=3")
    ordered(1, "the box has 2 numbers, and 3 axes need 6", "anna", "workspace_limit_m=box 0 0.1")
    who = run("who", "--state", folder)
    assert who.end() == 0
    assert "anna: position_scale=3 force_scale=0.5\n" in who.said.replace("\r", "")
    for process in (anna, server):
        process.signal(signal.SIGINT)
        process.end()
    theirs, ours = [summary_in(tmp_path / end)["users"][0] for end in ("server", "anna")]
    assert theirs["asked_stiffness_npm"] == ours["asked_stiffness_npm"]
    assert theirs["hand"] == ours["hand"]
    verdicts = replayed(Path(tmp_path))
    assert len(verdicts) == 2
    assert all(each.exact for each in verdicts.values())
