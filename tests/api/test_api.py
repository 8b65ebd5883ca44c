"""Tests of cogrip.api in virtual time: settings, runs, frames, and errors a caller can mend."""

from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cogrip.api as cogrip
from cogrip.devices.family import simulated as catalogue
from cogrip.devices.family.simulated import HandKind
from cogrip.devices.simulated.hands import ImpedanceSettings, make_hold
from cogrip.sim.laboratory import Laboratory

SHORT: dict[str, Any] = {"seconds": 0.5}


def test_settings_change_key_by_key_whatever_they_come_from(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('name = "mine"\nseconds = 3.0\n[coupling]\nstiffness_npm = 700.0\n[[users]]\nname = "eve"\n')
    for source in (str(file), file, {"name": "mine", "coupling": {"stiffness_npm": 700.0}, "users": [{"name": "eve"}]}):
        found = cogrip.settings(source, seconds=2.0, users={0: {"device_mass_kg": 0.3}})
        assert (found.name, found.seconds, found.coupling.stiffness_npm) == ("mine", 2.0, 700.0)
        assert (found.users[0].name, found.users[0].device_mass_kg) == ("eve", 0.3)
    again = cogrip.settings(found, coupling={"impedance_nspm": 10.0})
    assert (again.coupling.stiffness_npm, again.coupling.impedance_nspm) == (700.0, 10.0)


def device_settings(address: str) -> dict[str, Any]:
    return {"users": [{"name": "a", "device": address}], **SHORT}


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: cogrip.run("demmo"), "did you mean demo"),
        (lambda: cogrip.run("demo", stiffness=1.0), "stiffness"),
        (lambda: cogrip.run("demo", coupling={"stiffness_npm": -1.0}), "coupling.stiffness_npm"),
        (lambda: cogrip.run(device_settings("sim:phantomm")), "phantom"),
        (lambda: cogrip.run(device_settings("serial:/dev/ttyACM0")), "hardware"),
        (lambda: cogrip.open_run("nothing here"), "nothing here"),
        (lambda: cogrip.Session("demo", mine=["eve"]), "'eve' is nobody of this session; there is: anna, ben"),
        (lambda: cogrip.device_of(lambda time_s, force_n: (0.0,), peak_force_n=0.0), "peak_force_n"),
        (lambda: cogrip.device_of(lambda time_s, force_n: (0.0,), colour=1.0), "colour"),
    ],
)
def test_what_cannot_be_says_what_to_change(call: Callable[[], object], says: str) -> None:
    with pytest.raises(cogrip.ApiError, match=says):
        call()


def test_a_run_has_what_the_laboratory_has() -> None:
    seen: list[cogrip.Frame] = []
    run = cogrip.run("demo", on_frame=seen.append, **SHORT)
    laboratory = Laboratory(cogrip.settings("demo", **SHORT))
    laboratory.run()
    assert run.good
    assert run.people == ["anna", "ben"]
    ticks, steps = run.columns("anna", "force_n", "position_m"), run.columns("server", "object_m")
    assert ticks["force_n"].shape == (512, 1)
    assert tuple(ticks["force_n"][-1]) == laboratory.people[0].core.force_n == seen[-1].hands["anna"].force_n
    assert tuple(steps["object_m"][-1]) == tuple(laboratory.room.world.position) == seen[-1].object_m
    assert [frame.number for frame in seen] == list(range(1, 65))
    assert np.allclose(np.diff([frame.time_s for frame in seen]), 1.0 / 128.0)
    assert run.summary["users"][0]["peak_force_n"] == laboratory.people[0].core._seat.peaks.force_n
    with pytest.raises(KeyError, match="nobody called so"):
        run.columns("nobody called so")


def test_a_run_stays_where_a_folder_is_named_and_opens_again(tmp_path: Path) -> None:
    kept = cogrip.run("demo", folder=tmp_path, **SHORT)
    assert kept.folder.parent == tmp_path
    again = cogrip.open_run(kept.folder)
    assert again.settings == cogrip.settings("demo", **SHORT)
    columns = kept.columns("ben")
    for name in columns.keys() - {"time_s"}:
        column = columns[name]
        assert np.array_equal(column, again.columns("ben", name)[name], equal_nan=column.dtype.kind == "f")
    temporary = cogrip.run("demo", **SHORT)
    folder = temporary.folder
    assert folder.is_dir()
    del temporary
    assert not folder.exists()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_session_whose_callback_fails_says_so() -> None:
    """Callbacks run in threads: an error there would end a person's session, and look like a whole one; also afterwards."""
    session = cogrip.Session("demo", mine=["anna"])
    session._start(lambda: 1 / 0, "anna")
    for _ in range(2):
        with pytest.raises(cogrip.ApiError, match=r"^anna: ZeroDivisionError: division by zero$"):
            session.wait()


def test_a_function_is_a_device() -> None:
    pushed: list[tuple[float, ...]] = []

    def move(time_s: float, force_n: tuple[float, ...]) -> tuple[float, ...]:
        pushed.append(force_n)
        return (time_s, 0.0)

    device = cogrip.device_of(move, axes=2, peak_force_n=3.0, continuous_force_n=1.0)
    assert (device.capability.axes, device.capability.peak_force_n, device.capability.model) == (2, 3.0, "move")
    assert cogrip.device_of(move, peak_force_n=3.0).capability.continuous_force_n == 3.0
    with pytest.raises(cogrip.DeviceError, match="closed"):
        device.read(0)
    device.open(1024)
    device.write((1.0, -1.0))
    assert device.read(512) == cogrip.Sample((0.5, 0.0), None)
    device.close()
    device.open(1024)
    device.read(0)
    assert pushed == [(1.0, -1.0), (0.0, 0.0)]


class Settings(ImpedanceSettings, frozen=True, kw_only=True):
    extra: float = 0.0


def ours() -> HandKind:
    """Return a kind of hand, as an entry point does."""
    return HandKind(Settings, make_hold)


def hand_settings(hand: str) -> dict[str, Any]:
    return {"users": [{"name": "a", "hand": hand}], "seconds": 0.1}


def test_hands_of_one_s_own_are_found_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(catalogue, "_REGISTERED", {})
    with pytest.raises(cogrip.ApiError, match="mine"):
        cogrip.run(hand_settings("mine"))
    cogrip.register_hand("mine", make_hold, Settings)
    assert cogrip.run(hand_settings("mine&extra=1")).good
    with pytest.raises(cogrip.ApiError, match="extra"):
        cogrip.run(hand_settings("mine&extra=much"))
    for taken in ("hold", "no name"):
        with pytest.raises(cogrip.DeviceError, match="take another"):
            cogrip.register_hand(taken, make_hold)


def test_hands_of_another_package_are_found_and_their_faults_named(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [
        EntryPoint("theirs", f"{__name__}:ours", catalogue.GROUP),
        EntryPoint("broken", f"{__name__}:Settings", catalogue.GROUP),
        EntryPoint("absent", "no_such_package:hand", catalogue.GROUP),
    ]
    monkeypatch.setattr(catalogue, "entry_points", lambda group: points)
    catalogue._installed.cache_clear()
    try:
        assert cogrip.run(hand_settings("theirs&extra=1")).good
        for name, says in (("broken", "not a HandKind"), ("absent", "fails as it is loaded")):
            with pytest.raises(cogrip.ApiError, match=says):
                cogrip.run(hand_settings(name))
    finally:
        catalogue._installed.cache_clear()
