"""Live sessions of each method of ours over impaired networks: passive at both ends, and played again exactly."""

import re
import signal
from pathlib import Path

import msgspec
import pytest

from cogrip.protocol.wire.join_link import parse_link

from tests.extent import long
from tests.live.conftest import Relay
from tests.live.test_live_sessions import CONFIGS, DEMO, FEW_FRAMES, leaving, replayed, summary_in

LIFT = CONFIGS / "lift.toml"
REACH = ("sim:phantom?hand=reach&amplitude_m=0.02&stroke_s=0.6&delay_s=1&stop_s=3",)
GRASP = "gap_m=0.044&press_n=5&line_npm=560&lift_m=0.05&carry_m=0.04&hold_s=0.5"
GRASPS = (f"sim:ideal?hand=grasp&{GRASP}", f"sim:ideal?hand=grasp&direction=-1&{GRASP}")
METHODS = {
    "wave": (DEMO, (), 2 * REACH),
    "tuned": (DEMO, ("coupling.impedance_nspm=auto", "coupling.wave_filter_hz=auto", "coupling.prefer=light"), 2 * REACH),
    # from both sides: what both would push from the left, whoever is first pushes out of the other's reach
    "faces": (DEMO, ("coupling.kind=local", "object.kind=faces", "users.1.side=right"), (*REACH, "sim:phantom?hand=hold")),
    "lift": (LIFT, ("coupling.kind=local", "admission.force_n=1000"), GRASPS),
}  # fmt: skip


@pytest.mark.parametrize("network", [long("lan"), long("wan")])
@pytest.mark.parametrize("method", METHODS)
def test_a_live_session_over_a_network_is_passive_and_plays_again(
    serve, run, relay: Relay, tmp_path: Path, method, network
):
    config, settings, devices = METHODS[method]
    sets = [part for each in ("link.delay_ms=0", "playout.frames=auto", *settings) for part in ("--set", each)]
    server, port = serve(config, "--encrypted", "--state", str(tmp_path / "state"), *sets)
    _, place, end = relay(f"127.0.0.1:{port}", "--profile", network, "--seed", "3")
    link = msgspec.structs.replace(parse_link(re.search(r"as player: .*'(cogrip:\S+)'", server.said)[1]), port=place[1])
    people = [
        run("join", link.text, "--name", name, "--device", device, "--seconds", "5", *leaving(tmp_path / name))
        for name, device in zip(("anna", "ben"), devices, strict=True)
    ]
    assert [person.end() for person in people] == [0, 0], [person.said for person in people]
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    assert end()["totals"]["up"]["lost"] > 0 or network == "lan"
    for whole in map(summary_in, (tmp_path / "server", tmp_path / "anna", tmp_path / "ben")):
        assert whole["passive"], whole
        for user in whole["users"]:
            assert user["link"]["applied"] > FEW_FRAMES
            assert user["peak_force_n"] > 0.05, "the hand felt something"
            assert user["energy"]["up_margin_j"] >= -whole["credit_j"] - 1e-12
            assert user["energy"]["down_margin_j"] >= -whole["credit_j"] - 1e-12
            assert (user["energy"]["device_margin_j"] or 0.0) >= -1e-12
    verdicts = replayed(tmp_path)
    assert {path.name for path in verdicts} == {"server.mcap", "client-anna.mcap", "client-ben.mcap"}
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)
