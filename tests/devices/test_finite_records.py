"""No record is without bounds: those we ship, those that are made, and those that old recordings hold."""

import json
import re
from dataclasses import replace
from math import inf, isfinite, nan
from pathlib import Path

import msgspec
import pytest

from cogrip.client.recorder import start_of, start_text
from cogrip.devices.arm.models import MODELS as ARMS
from cogrip.devices.conformance import Subject, UnfitError, record_is_complete
from cogrip.devices.device import LARGEST, SLEW_NPS, SPEED_MPS, Capability, DeviceError
from cogrip.devices.forcedimension.models import RECORDS as FORCE_DIMENSION
from cogrip.devices.haply.models import MODELS as HAPLY
from cogrip.devices.openhaptics.models import RECORDS as OPENHAPTICS
from cogrip.devices.registry import describe, make
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.wire.session import make_hello

RECORDINGS = Path(__file__).resolve().parents[1] / "recordings"
BOUNDS = ("peak_force_n", "continuous_force_n", "stiffness_npm", "damping_nspm", "slew_nps", "speed_mps")
PHANTOM = make("sim:phantom", axes=3).capability


def all_records() -> dict[str, Capability]:
    records = {f"{listing.address} {axes}": listing.capability for axes in (1, 2, 3) for listing in describe(axes=axes)}
    models = {name: model.record for name, model in (*ARMS.items(), *HAPLY.items())}
    return {**records, **models, **OPENHAPTICS, **FORCE_DIMENSION}


@pytest.mark.parametrize(("name", "record"), all_records().items())
def test_every_record_that_ships_is_finite(name: str, record: Capability) -> None:
    assert not {"Infinity", "NaN"} & set(re.findall(r"\w+", json.dumps(msgspec.to_builtins(record))))
    assert record.slew_nps <= SLEW_NPS
    fast = name.startswith(("sim:ideal", "sim:freeflyer", "replay", "web:", "spacemouse:", "gamepad:"))
    assert record.speed_mps <= (4.0 if fast else SPEED_MPS)


@pytest.mark.parametrize("name", [*BOUNDS, "apparent_mass_kg"])
@pytest.mark.parametrize("value", [inf, nan, 0.0, -1.0, LARGEST * 1.001])
def test_a_record_without_a_bound_cannot_be_made(name: str, value: float) -> None:
    with pytest.raises(DeviceError, match=rf"record of sim:phantom: {name} = .* is no limit: state a number above 0"):
        replace(PHANTOM, **{name: value})
    if name != "continuous_force_n":
        assert getattr(replace(PHANTOM, **{name: LARGEST}), name) == LARGEST


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"continuous_force_n": 8.6}, "continuous_force_n = 8.6 is above peak_force_n = 8.5"),
        ({"axes": 0}, "axes = 0: a device has 1 to 6"),
        ({"axes": 7}, "axes = 7: a device has 1 to 6"),
        ({"resolution_m": inf}, "resolution_m = inf"),
        ({"resolution_m": -1e-9}, "resolution_m = -1e-09"),
        ({"workspace_m": ((-inf, 0.1),) * 3}, "workspace_m has"),
        ({"workspace_m": ((0.1, 0.1),) * 3}, "workspace_m has"),
    ],
)
def test_other_parts_of_a_record_that_are_none(changed: dict[str, object], said: str) -> None:
    with pytest.raises(DeviceError, match=said):
        replace(PHANTOM, **changed)


@pytest.mark.parametrize("key", ["slew_nps", "speed_mps"])
@pytest.mark.parametrize("value", ["inf", "nan", "0"])
def test_an_address_cannot_take_a_bound_away(key: str, value: str) -> None:
    with pytest.raises(DeviceError, match=f"{key}: expects .*; got '{value}'"):
        make(f"sim:phantom?{key}={value}")
    assert getattr(make(f"sim:phantom?{key}=3").capability, key) == 3.0


def test_the_conformance_suite_asks_for_a_rate_that_a_hand_can_be_held_at() -> None:
    class Slow:
        capability = replace(PHANTOM, rate_hz=249)
        counts: dict[str, int] = {}  # noqa: RUF012

    with pytest.raises(UnfitError, match="rate_hz is at least 250"):
        record_is_complete(Subject(Slow))  # type: ignore[arg-type]
    Slow.capability = replace(PHANTOM, rate_hz=250)
    record_is_complete(Subject(Slow))  # type: ignore[arg-type]


def old_table() -> dict[str, object]:
    """A record as it was written when bounds could be infinite."""
    endless = ("slew_nps", "speed_mps", "stiffness_npm", "damping_nspm")
    return {**msgspec.to_builtins(PHANTOM), **dict.fromkeys(endless, inf)}


def test_a_record_of_an_early_recording_is_read_with_todays_bounds() -> None:
    hello = make_hello(software="x", nonce=1, room="r", name="n", digest="", device="sim:", axes=3, rate_hz=1e3)
    text = json.dumps({"hello": msgspec.to_builtins(hello), "capability": old_table()})
    assert text.count("Infinity") == 4
    _, record = start_of(text)
    assert (record.slew_nps, record.speed_mps, record.stiffness_npm) == (1e3, 4.0, 2e4)
    assert replace(record, **{name: getattr(PHANTOM, name) for name in BOUNDS}) == PHANTOM, "all else as it stands"
    assert "Infinity" not in start_text(hello, record)
    assert start_of(start_text(hello, record)) == (hello, record)


@pytest.mark.parametrize("changed", [{"peak_force_n": inf}, {"slew_nps": nan}, {"slew_nps": -inf}, {"speed_mps": 0.0}])
def test_what_was_never_a_record_is_no_recording(changed: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="no limit"):
        Capability.recorded({**old_table(), **changed})


@pytest.mark.parametrize(
    "path", sorted(RECORDINGS.glob("*/client-*.mcap")), ids=lambda path: f"{path.parent.name}-{path.stem}"
)
def test_the_recordings_there_are_can_be_read(path: Path) -> None:
    """Whatever their records hold."""
    _, record = start_of(open_recording(path).header.start)
    assert all(isfinite(getattr(record, name)) for name in BOUNDS)
    who = path.stem.removeprefix("client-")
    assert make(f"replay:{path.parent}#user={who}").capability.slew_nps <= SLEW_NPS
