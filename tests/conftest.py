"""Hypothesis for everyone: the same examples on every run, and nothing that a clock decides.

What several test modules share stands in modules beside them, and is imported by its whole name: `tests.recorded_end`.
"""

import signal
import threading

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("cogrip", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("cogrip")

# A shell that starts this in the background ignores Ctrl-C, nohup a hang-up; whatever is started from here would inherit it.
if threading.current_thread() is threading.main_thread():
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda number, frame: None)  # nothing still; programs that we start forget it

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
    "tests.server.fuzzed_channels",
    "tests.server.recorded_rooms",
    "tests.server.encrypted_network",
)
