"""Two people under time-domain passivity control, as processes over UDP."""

import signal

from cogrip.protocol.passivity_control import LENT_J

from tests.live.test_live_sessions import DEMO, FEW_FRAMES, accounted, leaving, replayed, summary_in


def test_two_people_hold_a_cube_by_power_and_every_recording_plays_again(run, serve, tmp_path):
    server, port = serve(DEMO, "--set", "coupling.kind=tdpa")
    server.hear(r"warning: room demo: no advice: coupling.kind = \"tdpa\": a passivity controller is not linear")
    people = [
        run("join", f"127.0.0.1:{port}", "--name", name, "--device", "sim:phantom?hand=reach", "--seconds", "2",
            *leaving(tmp_path / name))
        for name in ("anna", "ben")
    ]  # fmt: skip
    assert [person.end() for person in people] == [0, 0], [person.said for person in people]
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    whole = summary_in(tmp_path / "server")
    assert not whole["diverged"]
    assert whole["object"]["travel_m"] > 0.005
    for user in whole["users"]:
        assert user["link"]["applied"] > FEW_FRAMES
        assert accounted(user["link"])
        assert user["energy"]["up_margin_j"] >= -LENT_J - 1e-12
        assert user["peak_force_n"] > 0.2
    verdicts = replayed(tmp_path)
    assert {path.name for path in verdicts} == {"server.mcap", "client-anna.mcap", "client-ben.mcap"}
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)
