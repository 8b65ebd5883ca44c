"""Extent of a test run, signals as an interactive shell leaves them, and helpers of which a failed assert explains itself.

`--quick`: units, in one process each. No flag: everything but what is marked `long`, and a few cases of what is marked
`sample`. `--all`: everything, with the full number of Hypothesis examples. The modules are namespace packages: a helper
beside the tests is imported by its whole name.
"""

import gc
import importlib
import os
import signal
import sys
import threading
from collections import defaultdict
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

pytest_plugins = ("tests.stalls",)
QUICK_FOLDERS = ("machine", "protocol", "devices", "client", "server")
NOT_QUICK = {  # modules in these folders that start processes, simulate whole sessions or play recordings again
    "test_altered_client_recording", "test_altered_recordings", "test_altered_server_recording", "test_arm_check",
    "test_arm_driver",
    "test_arm_identification", "test_arm_kinematics", "test_arm_records", "test_arm_weight", "test_certificate",
    "test_checkpoint_file", "test_device_conformance", "test_forcedimension", "test_haply_guard", "test_haply_hapi",
    "test_hid_line", "test_hostile_server", "test_lying_devices", "test_old_samples", "test_openhaptics_servo",
    "test_pseudo_terminal", "test_recorded_client_plays_again", "test_recorded_server_plays_again", "test_recorder",
    "test_recording_file", "test_recording_process", "test_recover", "test_replayed_motion",
    "test_report_socket", "test_ring", "test_state_folder", "test_stop", "test_token_file", "test_vendor_devices",
}  # fmt: skip
EXAMPLES = {"quick": 10, "default": 10, "all": 1000}
"""Examples of a law that names no number itself."""
TESTS = Path(__file__).parent
SHARE = {"quick": 0.05, "default": 0.05, "all": 1.0}
"""Share of the examples of a law that names a number."""
LEAST_EXAMPLES = 10

for _name, _examples in EXAMPLES.items():
    settings.register_profile(
        _name, deadline=None, derandomize=True, max_examples=_examples, suppress_health_check=[HealthCheck.too_slow]
    )

# An environment may forbid to write bytecode, as those of containers do: every process would compile all its modules anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# A shell that starts this in the background ignores Ctrl-C, nohup a hang-up; whatever is started from here would inherit it.
if threading.current_thread() is threading.main_thread():
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda number, frame: None)  # ignored here; programs that we start get the default

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
    "tests.sim.measured_impedance",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("extent")
    group.addoption("--quick", action="store_true", help="units only, in under a minute: for every commit")
    group.addoption("--all", action="store_true", help="also what is marked `long`, and every Hypothesis example")


def pytest_configure(config: pytest.Config) -> None:
    settings.load_profile(extent(config))
    gc.disable()  # until all is collected: nearly nothing of it is garbage


def extent(config: pytest.Config) -> str:
    """Return "quick", "default" or "all"."""
    if config.getoption("--all"):
        return "all"
    return "quick" if config.getoption("--quick") else "default"


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """With --quick, leave out the folders of sessions, commands and processes, and such modules in the others."""
    if extent(config) != "quick":
        return None
    if collection_path.is_dir():
        return True if collection_path.parent == TESTS and collection_path.name not in QUICK_FOLDERS else None
    return True if collection_path.stem in NOT_QUICK or collection_path.parent == TESTS else None


def pytest_collection(session: pytest.Session) -> None:
    """Import the modules beforehand, each worker from another one on: each is then compiled by one of them, not by all."""
    worker, workers = (int(os.environ.get(f"PYTEST_XDIST_WORKER{each}", "0").lstrip("gw")) for each in ("", "_COUNT"))
    if not workers or session.config.args != session.config.getini("testpaths"):
        return
    folders = QUICK_FOLDERS if extent(session.config) == "quick" else ("",)
    paths = sorted(path for folder in folders for path in (TESTS / folder).rglob("test_*.py"))
    paths = [path for path in paths if not pytest_ignore_collect(path, session.config)]
    first = len(paths) * worker // workers
    for path in paths[first:] + paths[:first]:
        with suppress(Exception, pytest.skip.Exception):  # the collection itself says so
            importlib.import_module(".".join(path.relative_to(TESTS.parent).with_suffix("").parts))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect what this extent leaves out, and give each law its number of examples."""
    chosen = extent(config)
    named = any("::" in argument for argument in config.args)  # a test that is asked for by name always runs
    deselected = (
        [item for item in items if item.get_closest_marker("long")] + _beyond_samples(items) if chosen != "all" else []
    )
    if deselected and not named:
        config.hook.pytest_deselected(items=deselected)
        left_out = set(deselected)
        items[:] = [item for item in items if item not in left_out]
    if chosen != "all":
        for item in items:
            _limit_examples(item, SHARE[chosen])


def _beyond_samples(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return the cases that `sample` leaves out: of each test, all but `count`, evenly spread and the first among them."""
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("sample") and not item.get_closest_marker("long"):
            cases[item.nodeid.partition("[")[0]].append(item)
    left_out = []
    for each in cases.values():
        (count,) = each[0].get_closest_marker("sample").args  # type: ignore[union-attr]
        kept = {len(each) * number // count for number in range(count)}
        left_out += [item for place, item in enumerate(each) if place not in kept]
    return left_out


def pytest_collection_finish(session: pytest.Session) -> None:
    """Never look for garbage among what the collection made: 6 % of the processor time of all tests."""
    gc.freeze()
    gc.set_threshold(200_000)
    gc.enable()
    if extent(session.config) != "all":
        _try_scenes_here()


def _try_scenes_here() -> None:
    """Have scenes tried in this process: to fork one that has all tests takes 40 ms. tests/server/test_trial.py forks."""
    if scene_file := sys.modules.get("cogrip.server.worlds.scenes.scene_file"):
        scene_file.tried = lambda trial: trial()  # type: ignore[attr-defined]


def _limit_examples(item: pytest.Item, share: float) -> None:
    """Lower the number of examples that a test sets itself by @settings, or a state machine by its `TestCase.settings`."""
    state_machine = getattr(getattr(item, "cls", None), "settings", None)
    if isinstance(state_machine, settings):
        item.cls.settings = _limited(state_machine, share)  # type: ignore[attr-defined]
        return
    test = getattr(item, "obj", None)
    own = getattr(
        test, "_hypothesis_internal_use_settings", None
    )  # Hypothesis gives no public access to a test's settings
    if isinstance(own, settings):
        test._hypothesis_internal_use_settings = _limited(own, share)  # type: ignore[union-attr]


def _limited(own: settings, share: float) -> settings:
    if own.max_examples == settings.default.max_examples:  # type: ignore[attr-defined]
        return own
    least = min(own.max_examples, LEAST_EXAMPLES)
    return settings(own, max_examples=max(least, round(share * own.max_examples)))
