"""`rates.network_hz = "auto"`: the frame rate at which the loop is shortest, of those that device loop, link and server bear.

A choice by settings alone, so that everybody who reads a file has the same rate, and every run is written with a number.
"""

from collections.abc import Sequence
from typing import Any, Protocol

from cogrip.protocol.line.delays import Direction, PlayoutDelay, line_delay
from cogrip.protocol.rates import Rates, misfit

AUTO = "auto"
RATES_HZ = (128, 256, 512, 1024)
PERSON_S = 120e-6  # of a server's time for one person's frame, encrypted and recorded (`dev.py bench network`)
WORLD_S = 500e-6  # for a scene's frame; the objects that come with the runtime cost next to nothing
SERVER_SHARE = 0.4  # of a processor that one room may take
LINK_SHARE = 0.5  # of a link's capacity that one line may take
HEAD_BYTES = 160  # of a datagram: IP, UDP and DTLS headers, all of its message but waves and totals
REAL_BYTES = 9


class Way(Direction, Protocol):
    """Settings of one direction of a link."""

    @property
    def rate_kbps(self) -> float: ...


def take_auto(table: dict[str, Any]) -> bool:
    """Return whether a settings table asks for "auto", and take that out of it."""
    rates = table.get("rates")
    if not isinstance(rates, dict) or rates.get("network_hz") != AUTO:
        return False
    del rates["network_hz"]
    return True


def best_rate(device_hz: Sequence[int], axes: int, scene: bool, playout: PlayoutDelay, ways: Sequence[Way]) -> int:
    """Return the network rate [Hz]; the lowest where none is borne, which the settings' own checks then judge.

    device_hz: each person's; ways: each direction of the link.
    """
    datagram_bytes = HEAD_BYTES + REAL_BYTES * axes * (playout.redundancy + 4)
    frame_s = PERSON_S * len(device_hz) + WORLD_S * scene

    def borne(hz: int) -> bool:
        return (
            not any(misfit(each, hz) for each in device_hz)
            and frame_s * hz <= SERVER_SHARE
            and all(8e-3 * datagram_bytes * hz <= LINK_SHARE * way.rate_kbps for way in ways if way.rate_kbps)
        )

    def loop_s(hz: int) -> float:
        rates = Rates(min(device_hz), hz)
        return sum(line_delay(playout, way, rates).ticks for way in ways) * rates.tick_s + rates.frame_s

    return min((hz for hz in RATES_HZ if borne(hz)), key=loop_s, default=RATES_HZ[0])
