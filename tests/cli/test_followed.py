"""Recordings followed as they grow, for live tables."""

from pathlib import Path

from cogrip.cli.session.live_views import FollowedRun

from tests.cli.spoiled_runs import ANNA, damage


def test_a_damaged_recording_shows_what_came_before_the_damage(run: Path) -> None:
    whole = FollowedRun(run).tick("anna")
    assert whole is not None
    damage(run / ANNA)
    followed = FollowedRun(run)
    for _ in range(2):
        tick = followed.tick("anna")
        assert tick is None or tick.tick < whole.tick
