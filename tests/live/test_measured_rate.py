"""`rates.network_hz = "auto"` in real processes: the server measures, says and writes it; people join with the file."""

import json
import re
import signal
from pathlib import Path

import pytest

from cogrip.protocol.settings.network_rate import RATES_HZ, RateChoice
from cogrip.results.reading.folder import SETTINGS

FILE = """
name = "box"
[object]
kind = "scene"
file = "wall.xml"
axes = 6
[coupling]
kind = "local"
[rates]
network_hz = "auto"
[[users]]
name = "anna"
tool = "ball"
device = "sim:phantom6"
hand = "waypoints&times_s=0.3,0.8&x_m=0,0.1&rz_rad=0,0.2"
"""


@pytest.mark.long
def test_a_server_that_chose_its_rate_is_joined_with_the_file_that_asks_for_auto(run, serve, tmp_path: Path) -> None:
    config = tmp_path / "box.toml"
    config.write_text(FILE)
    server, port = serve(config)
    assert re.search(r"room box: rates\.network_hz = \d+: .* \(measured in \d+ frames\)", server.said), server.said
    anna = run(
        "join", f"127.0.0.1:{port}", "--config", config, "--seconds", "2.5", "--runs", tmp_path / "anna", "--no-report"
    )
    assert anna.end() == 0, anna.said
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    (folder,) = (tmp_path / "server").iterdir()
    choice = json.loads((folder / "network_rate.json").read_text())
    assert RateChoice(**choice).by == "measured"
    assert choice["frames"] >= 1
    assert json.loads((folder / SETTINGS).read_text())["rates"]["network_hz"] == choice["network_hz"]
    assert choice["network_hz"] in RATES_HZ
    (alone,) = (tmp_path / "anna").iterdir()
    (user,) = json.loads((alone / "summary.json").read_text())["users"]
    assert user["felt_stiffness_npm"] is None or user["felt_stiffness_npm"] == pytest.approx(1000.0, rel=0.03)
    assert user["peak_force_n"] > 1.0
