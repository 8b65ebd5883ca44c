"""Hypothesis for everyone: the same examples on every run, and no wall-clock deadline.

What several test modules share stands in modules beside them, and is imported by its whole name: `tests.recorded_end`.
"""

import pytest
from hypothesis import settings

settings.register_profile("cogrip", deadline=None, derandomize=True)
settings.load_profile("cogrip")

# Only test modules explain a failed assert by themselves.
pytest.register_assert_rewrite(
    "tests.recorded_end",
    "tests.client.recorded_person",
    "tests.client.seated_client",
    "tests.devices.replayed_hands",
    "tests.live.held_arms",
    "tests.server.recorded_rooms",
)
