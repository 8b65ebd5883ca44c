"""Lab Streaming Layer, without I/O: what its two streams are made of, and one sample of each moment.

The state stream has the room's step, the object and every seat; the marker stream one text a sample. Each sample has the time
at which the server made it, on this machine's monotonic clock, which is LSL's: the clock estimate (SPEC 8) takes it there, and
LSL takes it on to other machines.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

from cogrip.client.observer import ObserverCore
from cogrip.protocol.axes import PLACES
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.server.seats.observers import VIEWS_HZ

AXES = "xyz"


@dataclass(frozen=True, slots=True)
class Channel:
    """One number of a sample. unit: as LSL's metadata names it."""

    label: str
    unit: str
    kind: str


def channels(seat: SeatSettings) -> list[Channel]:
    """Return the channels of the state stream of a room with this seat's settings."""
    axes = AXES[: min(PLACES, seat.object.axes)]
    found = [Channel("step", "frames", "Counter"), Channel("clock_uncertainty", "seconds", "Time")]
    found += [Channel(f"object_{axis}", "meters", "Position") for axis in axes]
    found += [Channel(f"object_v{axis}", "meters/second", "Velocity") for axis in axes]
    for number in range(seat.people):
        found += [Channel(f"seat{number}_{axis}", "meters", "Position") for axis in axes]
        found += [Channel(f"seat{number}_f{axis}", "newtons", "Force") for axis in axes]
    return found


def rate_hz(seat: SeatSettings) -> float:
    """Return how many samples of the state there are a second."""
    return seat.rates.network_hz / -(-seat.rates.network_hz // VIEWS_HZ)


class LabStreams:
    """Samples from what an observer gets."""

    def __init__(self, seat: SeatSettings) -> None:
        self._axes = min(PLACES, seat.object.axes)
        self._people = seat.people
        self._frame_s = seat.rates.frame_s
        self._seen = 0
        self._views: dict[
            int, tuple[int, float]
        ] = {}  # step and time of the newest of a session, of the last two sessions

    def state(self, core: ObserverCore) -> tuple[float, list[float]] | None:
        """Return the time [s] and the sample of a view that has come since the last call.

        None where there is none, or the clocks' offset is not known yet.
        """
        view, clock = core.view, core.session.clock
        if view is None or core.views == self._seen or clock.offset_ns is None or clock.uncertainty_ns is None:
            return None
        self._seen = core.views
        at_s = (view.stamp.sent_ns - clock.offset_ns) * 1e-9
        self._views[view.session] = view.number, at_s
        if len(self._views) > 2:
            del self._views[next(iter(self._views))]
        axes, width = self._axes, 2 * self._axes
        sample = [float(view.number), clock.uncertainty_ns * 1e-9, *view.object[:width]]
        people = [nan] * (width * self._people)
        for row, seat in enumerate(view.seats):
            if seat < self._people:
                span = slice(axes * row, axes * (row + 1))
                people[width * seat : width * (seat + 1)] = [*view.proxies_m[span], *view.forces_n[span]]
        return at_s, sample + people

    def markers(self, core: ObserverCore) -> Sequence[tuple[float, str]]:
        """Return time [s] and text of the markers that have come since the last call, from the first view on.

        A server that began anew counts other steps: a marker of its session waits for a view of that.
        """
        if not self._seen:
            return ()
        welcome, wait, found = core.session.welcome, [], []
        for mark in core.marked:
            view = self._views.get(mark.session)
            if view is None and welcome is not None and mark.session == welcome.session:
                wait.append(mark)
                continue
            step, at_s = view or (mark.step, list(self._views.values())[-1][1])
            who = core.people[mark.seat].name if mark.seat in core.people else ""
            found.append((at_s + (mark.step - step) * self._frame_s, f"{who}: {mark.text}" if who else mark.text))
        core.marked[:] = wait
        return found
