"""`rates.network_hz = "auto"`: the frame rate at which the loop is shortest, of those that device loop, link and server bear.

What a frame takes the server is stated here, so that everybody who reads a file has the same rate, or measured where one is
served (`cogrip.sim.frame_cost`). Every run is written with a number.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol

import msgspec

from cogrip.machine.addition import add_floats
from cogrip.protocol.settings.delays import Direction, PlayoutDelay, line_delay
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.rates import Rates, misfit
from cogrip.protocol.settings.sections import Settings

AUTO = "auto"
RATES_HZ = (128, 256, 512, 1024)
PERSON_S = 120e-6  # time that one person's frame takes a server, encrypted and recorded (`dev.py bench network`)
WORLD_S = 500e-6  # time that a scene's frame takes; the objects that come with the runtime cost next to nothing
OUTSIDE_S = 100e-6  # part of PERSON_S for socket, encryption and recording, which no measurement in one process has
SERVER_SHARE = 0.4  # share of a processor that one room may take
LINK_SHARE = 0.5  # share of a link's capacity that one line may take
HEAD_BYTES = 160  # bytes of a datagram beside waves and totals: IP, UDP and DTLS headers, the rest of its message
REAL_BYTES = 9


class RateChoice(msgspec.Struct, frozen=True):
    """Choice of "auto", and by what: "kept" is that of a server that was killed, to which a checkpoint belongs.

    frame_s: of the server's time for a frame of everybody, unless it was kept; frames: that were measured
    """

    network_hz: int
    by: Literal["stated", "measured", "kept"]
    frame_s: float | None = None
    frames: int = 0

    @property
    def text(self) -> str:
        """The choice in one line."""
        if self.frame_s is None:
            return (
                f"rates.network_hz = {self.network_hz}: as it was when the server was killed, whose checkpoint is there"
            )
        how = f"measured in {self.frames} frames" if self.by == "measured" else "as stated: no clock has a say"
        return (
            f"rates.network_hz = {self.network_hz}: a frame takes the server {1e6 * self.frame_s:.0f} µs ({how}), "
            f"of {SERVER_SHARE:g} s a second that a room may take"
        )


class DirectionRate(Direction, Protocol):
    """Settings of one direction of a link."""

    @property
    def rate_kbps(self) -> float: ...


def asks_auto(table: Mapping[str, Any], overrides: Mapping[str, Any]) -> bool:
    """Return whether a settings table with `--set` overrides asks for "auto"."""
    rates = table.get("rates")
    written = rates.get("network_hz") if isinstance(rates, Mapping) else None
    asked: bool = overrides.get("rates.network_hz", written) == AUTO
    return asked


def take_auto(table: dict[str, Any]) -> bool:
    """Return whether a settings table asks for "auto", and take that out of it."""
    if not asks_auto(table, {}):
        return False
    del table["rates"]["network_hz"]
    return True


def stated_frame_s(settings: Settings) -> float:
    """Return what a frame takes the server by the numbers above [s]."""
    return PERSON_S * len(settings.users) + WORLD_S * (not kind_of(settings.object.kind).plain)


def best_rate(
    device_hz: Sequence[int], axes: int, frame_s: float, playout: PlayoutDelay, link: Sequence[DirectionRate]
) -> int:
    """Return the network rate [Hz]; the lowest where none is borne, which the settings' own checks then judge.

    device_hz: each person's; frame_s: of the server's time for a frame of everybody; link: its directions.
    """
    datagram_bytes = HEAD_BYTES + REAL_BYTES * axes * (playout.redundancy + 4)

    def borne(hz: int) -> bool:
        return (
            not any(misfit(each, hz) for each in device_hz)
            and frame_s * hz <= SERVER_SHARE
            and all(8e-3 * datagram_bytes * hz <= LINK_SHARE * each.rate_kbps for each in link if each.rate_kbps)
        )

    def loop_s(hz: int) -> float:
        rates = Rates(min(device_hz), hz)
        return add_floats(line_delay(playout, each, rates).ticks for each in link) * rates.tick_s + rates.frame_s

    return min((hz for hz in RATES_HZ if borne(hz)), key=loop_s, default=RATES_HZ[0])
