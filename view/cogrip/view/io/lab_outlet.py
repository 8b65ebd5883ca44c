"""Outlets of the Lab Streaming Layer: pylsl, which the extra `lsl` brings."""

from collections.abc import Sequence
from typing import Any

from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.version import VERSION
from cogrip.view.lab_streams import channels, rate_hz


class OutletError(Exception):
    """No stream can be offered. The text says why and what to do."""


class LabOutlet:
    """Two streams of one room: `cogrip ROOM state` and `cogrip ROOM markers`. Raises OutletError.

    state_info  how the first is described
    """

    def __init__(self, seat: SeatSettings, server: str) -> None:
        try:
            import pylsl  # type: ignore[import-untyped]

            pylsl.local_clock()
        except (ImportError, RuntimeError, OSError) as error:
            raise OutletError(f"pylsl with liblsl is needed: pip install 'cogrip[lsl]' ({error})") from None
        lines = channels(seat)
        name, source = f"cogrip {seat.room}", f"cogrip {server} {seat.room}"
        # Views may be lost: a reader of XDF spaces the samples of a stream with a rate evenly, over what is missing.
        irregular = pylsl.IRREGULAR_RATE
        state = pylsl.StreamInfo(f"{name} state", "Haptics", len(lines), irregular, "double64", f"{source} state")
        described = state.desc().append_child("channels")
        for line in lines:
            channel = described.append_child("channel")
            for key, value in (("label", line.label), ("unit", line.unit), ("type", line.kind)):
                channel.append_child_value(key, value)
        markers = pylsl.StreamInfo(f"{name} markers", "Markers", 1, irregular, "string", f"{source} markers")
        for info in (state, markers):
            made_by = info.desc().append_child("acquisition")
            made_by.append_child_value("manufacturer", "cogrip")
            made_by.append_child_value("model", VERSION)
        state.desc().append_child_value("views_per_second", f"{rate_hz(seat):g}")
        self.state_info: Any = state
        self._state: Any = pylsl.StreamOutlet(state)
        self._markers: Any = pylsl.StreamOutlet(markers)

    def push(self, state: tuple[float, list[float]] | None, markers: Sequence[tuple[float, str]]) -> None:
        """Send what is new, each with its time [s] on the monotonic clock."""
        if state is not None:
            self._state.push_sample(state[1], state[0])
        for at_s, text in markers:
            self._markers.push_sample([text], at_s)
