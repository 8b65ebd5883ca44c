"""A live session through the Lab Streaming Layer: real outlets, and liblsl's own inlets."""

import csv
import signal
from pathlib import Path

import numpy as np
import pytest

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.settings.room import seat_settings
from cogrip.results.reading.records import open_run
from cogrip.view.io.lab_outlet import LabOutlet
from cogrip.view.lab_streams import channels, rate_hz

from tests.view.xdf_file import write_xdf

CONFIG = Path(__file__).parents[2] / "configs" / "demo.toml"
LIMIT_S = 20.0
LATEST_S = 0.25  # of a clock estimate on one machine, with all that schedulers may add


@pytest.fixture(scope="module")
def lsl(tmp_path_factory: pytest.TempPathFactory):
    """Return pylsl, kept to this machine."""
    api = tmp_path_factory.mktemp("lsl") / "lsl_api.cfg"
    api.write_text("[multicast]\nResolveScope = machine\n[lab]\nKnownPeers = {127.0.0.1}\n[log]\nlevel = -3\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LSLAPICFG", str(api))
        pylsl = pytest.importorskip("pylsl", reason="the extra lsl is not installed")
        try:
            pylsl.library_version()
        except (RuntimeError, OSError) as error:
            pytest.skip(f"liblsl is not here: {error}")
        yield pylsl


def inlet(pylsl, name: str):
    found = pylsl.resolve_byprop("name", name, timeout=LIMIT_S)
    assert found, name
    opened = pylsl.StreamInlet(found[0])
    opened.open_stream(timeout=LIMIT_S)
    return opened


def test_state_and_markers_arrive_with_the_times_at_which_they_were_made(run, serve, tmp_path, lsl):
    folder = tmp_path / "state"
    server, port = serve(CONFIG, "--state", folder)
    clock = tmp_path / "clock.csv"
    outlet = run("lsl", f"127.0.0.1:{port}", "--clock", clock)
    outlet.hear("room demo is offered")
    state, markers = inlet(lsl, "cogrip demo state"), inlet(lsl, "cogrip demo markers")
    anna = run("join", f"127.0.0.1:{port}", "--name", "anna", "--runs", tmp_path / "anna", "--no-report")
    anna.hear("anna holds cube")
    marked = run("mark", "the lamp goes on", "--state", folder)
    assert marked.end() == 0, marked.said
    text, marker_s = markers.pull_sample(timeout=LIMIT_S)
    assert text == ["the lamp goes on"]
    marker_s += markers.time_correction(timeout=LIMIT_S)
    samples = [state.pull_sample(timeout=LIMIT_S) for _ in range(64)]
    labels = [each["label"] for each in channels_of(state)]
    correction_s, here_s = state.time_correction(timeout=LIMIT_S), lsl.local_clock()
    for process in (anna, outlet, server):
        process.signal(signal.SIGINT)
        process.end()
    assert labels[:4] == ["step", "clock_uncertainty", "object_x", "object_vx"]
    values = np.array([sample for sample, _ in samples])
    times_s = np.array([at_s for _, at_s in samples]) + correction_s
    steps = values[:, 0]
    (left,) = (tmp_path / "server").iterdir()
    recorded = open_run(left)
    columns = recorded.server.columns("step", "step", "object_m")
    place = dict(zip(columns["step"].astype(int), columns["object_m"][:, 0], strict=True))
    assert [place[int(step)] for step in steps] == list(values[:, 2])
    assert np.all(values[:, 1] < LATEST_S)
    assert times_s[-1] <= here_s + LATEST_S
    # the server's recording has the same marker; between both clocks there is one offset
    at = dict(zip(columns["step"].astype(int), columns["time_s"], strict=True))
    offset_s = np.median([at[int(step)] - time_s for step, time_s in zip(steps, times_s, strict=True)])
    ((recorded_s, said),) = recorded.markers()
    assert said == "the lamp goes on"
    assert marker_s + offset_s == pytest.approx(recorded_s, abs=LATEST_S)
    rows = list(csv.DictReader(clock.read_text().splitlines()))
    assert rows
    assert all(abs(float(row["server_s"]) - float(row["lsl_s"])) < LATEST_S for row in rows), "one machine, one clock"


def channels_of(stream) -> list[dict[str, str]]:
    found, channel = [], stream.info(timeout=LIMIT_S).desc().child("channels").child("channel")
    while not channel.empty():
        found.append({"label": channel.child_value("label"), "unit": channel.child_value("unit")})
        channel = channel.next_sibling("channel")
    return found


@pytest.mark.parametrize("lost", ["one view in a hundred", "half a second"])
def test_a_reader_of_xdf_leaves_every_time_where_views_were_lost(tmp_path, lsl, lost: str) -> None:
    """With a nominal rate pyxdf spaces samples evenly: beside their times, and the further the longer a session is."""
    pyxdf = pytest.importorskip("pyxdf")
    seat = seat_settings(load(Path("demo")), 0)
    outlet = LabOutlet(seat, "a test")
    rows = np.arange(0.0, 60.0, 1.0 / rate_hz(seat))
    random = np.random.default_rng(1)
    kept = random.random(len(rows)) > 0.01 if lost == "one view in a hundred" else (rows < 12.0) | (rows > 12.5)
    times_s = rows[kept]
    file = tmp_path / "views.xdf"
    width = len(channels(seat))
    write_xdf(file, outlet.state_info.as_xml(), times_s, [[at_s] * width for at_s in times_s])
    (stream,), _ = pyxdf.load_xdf(str(file), dejitter_timestamps=True)
    assert np.abs(stream["time_stamps"] - stream["time_series"][:, 0]).max() < 1e-9
    assert float(stream["info"]["desc"][0]["views_per_second"][0]) == rate_hz(seat)
