"""The record of a tick keeps bytes from the tick before: it is the same as one that keeps nothing."""

from math import cos, nan, sin
from typing import Any

import msgspec
import pytest

from cogrip.client.recorder import TICK
from cogrip.client.tick_record import TickRecord
from cogrip.devices.device import Device, Sample
from cogrip.protocol.recording.records import Tick
from cogrip.protocol.recording.sink import encode, pack
from cogrip.protocol.settings.room import resolve
from cogrip.sim import laboratory as session_laboratory
from cogrip.sim.laboratory import Laboratory, make_for


class Varied:
    """A device that gives one reading of every kind: plain, old, none, not finite, with buttons, a handle, signs of zero."""

    def __init__(self, device: Device) -> None:
        self._device = device
        self.capability = device.capability
        self.newest: Sample | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._device, name)

    def read(self, tick: int) -> Sample | None:
        sample, kind = self._device.read(tick), tick // 3 % 16
        assert sample is not None
        zero = -0.0 if tick % 2 else 0.0
        changes: dict[int, dict[str, Any]] = {
            3: {"age_ticks": 1},
            5: {"buttons": tick % 2},
            7: {"position_m": (nan, *sample.position_m[1:])},
            9: {"orientation": (cos(tick), 0.0, zero, sin(tick))},
            11: {"grip_m": zero},
        }
        self.newest = None if kind == 13 and tick % 3 else sample.replaced(**changes.get(kind, {}))
        return self.newest


@pytest.mark.parametrize("encoder", [encode, pack])
@pytest.mark.parametrize("device", ["sim:phantom?hand=reach", "sim:ideal?hand=reach"])
def test_a_record_is_that_of_an_encoder_without_memory(
    monkeypatch: pytest.MonkeyPatch, encoder: Any, device: str
) -> None:
    monkeypatch.setattr(session_laboratory, "make_for", lambda user, axes: Varied(make_for(user, axes)))
    settings = resolve(
        {"users": [{"name": "anna", "device": device}], "object": {"axes": 3}, "seconds": 1.5,
         "link": {"delay_ms": 8.0, "jitter_ms": 4.0, "loss": 0.2}}
    )  # fmt: skip
    laboratory = Laboratory(settings)
    core, varied = laboratory.people[0].core, laboratory.people[0].device
    assert isinstance(varied, Varied)
    assert core.seated is not None
    read = msgspec.json.Decoder(Tick) if encoder is encode else msgspec.msgpack.Decoder(Tick)
    seen: list[Tick] = []

    class Checking:
        keeps = True

        def put(self, topic: int, time_ns: int, payload: bytes) -> None:
            if topic != TICK:
                return
            tick = read.decode(payload)
            timing = tick.late_us, tick.work_us, tick.skipped
            assert payload == TickRecord(encoder).of(core.seated, varied.newest, tick.force_n, timing, core.delays)
            assert payload == encoder(tick), "whole"
            seen.append(tick)

    def vary(running: Laboratory) -> None:
        """Change, one at a time, what the record keeps: what changes in a session changes at once with other numbers."""
        tick, coupling, delays = core.tick, core.coupling, core.delays
        core.timing = tick % 3, tick % 5, tick // 5
        match tick % 13:
            case 1:
                delays.rtt_ms = 0.1 * tick
            case 3:
                delays.up_ms = 0.1 * tick
            case 5:
                delays.down_ms = 0.1 * tick
            case 7:
                coupling.down_margin_j = -1e-6 * tick
            case 9:
                coupling.down_reserve.balance_j = 1e-6 * tick
            case 11:
                coupling.object_state = tuple([1e-6 * tick] * 6)

    core.record(Checking(), encoder)
    laboratory.run(vary)
    assert len(seen) > 1400
    assert {tick.buttons for tick in seen} == {0, 1}
    assert len({tick.skipped for tick in seen}) > 280
