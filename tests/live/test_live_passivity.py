"""Two people under time-domain passivity control: as processes over UDP, and the same session in virtual time."""

import signal

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.laws.passivity_control import LENT_J
from cogrip.results.writing.summary import of_laboratory
from cogrip.sim.laboratory import Laboratory

from tests.live.test_live_sessions import DEMO, FEW_FRAMES, accounted, leaving, replayed, summary_in

TDPA = "coupling.kind=tdpa"
LET_GO = "the force oscillates at the hand"


def test_what_processes_exchange_is_passive_and_every_recording_plays_again(run, serve, tmp_path):
    """Assert what holds however late the loops are: a passivity controller that is late switches, and may let the hand go."""
    server, port = serve(DEMO, "--set", TDPA)
    server.hear(r"warning: room demo: no advice: coupling.kind = \"tdpa\": a passivity controller is not")
    people = [
        run("join", f"127.0.0.1:{port}", "--name", name, "--device", "sim:phantom?hand=reach", "--seconds", "1.5",
            *leaving(tmp_path / name))
        for name in ("anna", "ben")
    ]  # fmt: skip
    for person in people:
        assert person.end() == 0 or LET_GO in person.said, person.said
    server.signal(signal.SIGTERM)
    assert server.end() == 0, server.said
    for user in summary_in(tmp_path / "server")["users"]:
        assert user["link"]["applied"] > FEW_FRAMES
        assert accounted(user["link"])
        assert user["energy"]["up_margin_j"] >= -LENT_J - 1e-12
    verdicts = replayed(tmp_path)
    assert {path.name for path in verdicts} == {"server.mcap", "client-anna.mcap", "client-ben.mcap"}
    for file, verdict in verdicts.items():
        assert verdict.exact, (file, verdict.difference, verdict.hole)


def test_loops_that_are_on_time_hold_the_cube_without_oscillation():
    users = [f"users.{number}.{key}" for number in (0, 1) for key in ("device=sim:phantom", "hand=reach")]
    laboratory = Laboratory(load(DEMO, (TDPA, "seconds=2", *users)))
    laboratory.run()
    whole = of_laboratory(laboratory)
    assert not any(whole[key] for key in ("unstable", "saturated", "left"))
    assert whole["object"]["travel_m"] > 0.005
    for user in whole["users"]:
        assert (user["state"], user["reason"]) == ("live", "")
        assert user["peak_force_n"] > 0.2
