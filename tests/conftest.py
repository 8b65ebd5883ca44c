"""Hypothesis for everyone: the same examples on every run, and no wall-clock deadline.

What several test modules share stands in modules beside them, and is imported by its whole name: `tests.recorded_end`.
"""

import signal
import threading

import pytest
from hypothesis import settings

settings.register_profile("cogrip", deadline=None, derandomize=True)
settings.load_profile("cogrip")

# A shell that starts this in the background ignores Ctrl-C, and whatever is started from here would inherit that.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Only test modules explain a failed assert by themselves.
pytest.register_assert_rewrite(
    "tests.recorded_end",
    "tests.client.recorded_person",
    "tests.client.seated_client",
    "tests.devices.replayed_hands",
    "tests.live.held_arms",
    "tests.protocol.foreign_peers",
    "tests.protocol.spec_page",
    "tests.protocol.two_ends",
    "tests.server.fuzzed_doors",
    "tests.server.recorded_rooms",
    "tests.server.sealed_wire",
)
