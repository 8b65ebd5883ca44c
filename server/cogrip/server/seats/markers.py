"""Markers of a room: short texts with the step they belong to, told to everybody in it."""

from collections import Counter, deque
from collections.abc import Sequence

from msgspec.structs import replace

from cogrip.protocol.settings.task import EVERYBODY
from cogrip.protocol.settings.types import SeatNumber
from cogrip.protocol.texts import clipped_mark
from cogrip.protocol.wire.messages import Mark

TOLD_S = 2.0  # time for which each marker is repeated: of datagrams lost in bursts one comes through
TOLD_HZ = 16
MOST_TOLD = 64  # most markers that are told at once
A_SECOND = 10  # number of markers of one seat a second, on average
BURST = 20
MOST_TAKEN = 64  # most markers of one seat that are known when they are repeated: a client has fewer on their way


class RoomMarkers:
    """Those of one room. `add` takes one, `due` gives the messages of a step.

    refused  how many came faster than one seat may set them
    """

    def __init__(self, network_hz: int) -> None:
        self._every = max(1, network_hz // TOLD_HZ)
        self._steps = round(TOLD_S * network_hz)
        self._told: deque[Mark] = deque()  # at most MOST_TOLD
        self._count = 0
        self._left: dict[SeatNumber, tuple[float, int]] = {}  # markers that a seat may set now, as of a step
        self._hz = network_hz
        self._taken: dict[SeatNumber, dict[int, Mark]] = {}  # by their number there, oldest first

    def add(self, text: str, step: int, seat: SeatNumber | None = None, theirs: int = 0) -> Mark | None:
        """Take a marker. seat: that of the person who set it, with `theirs` as its number there. None for one too many."""
        if seat is not None:
            left, before = self._left.get(seat, (float(BURST), step))
            left = min(float(BURST), left + A_SECOND * (step - before) / self._hz)
            if left < 1.0:
                return None
            self._left[seat] = left - 1.0, step
        self._count += 1
        mark = Mark(1, self._count, clipped_mark(text), step, seat, theirs)
        if len(self._told) == MOST_TOLD:
            self._leave_out()
        self._told.append(mark)
        if seat is not None:
            taken = self._taken.setdefault(seat, {})
            taken[theirs] = mark
            if len(taken) > MOST_TAKEN:
                del taken[next(iter(taken))]
        return mark

    def _leave_out(self) -> None:
        """Stop repeating the oldest marker of whoever set most: nobody can keep out the markers of others."""
        counts = Counter(mark.seat for mark in self._told)
        del counts[None]
        most = counts.most_common(1)[0][0] if counts else None
        self._told.remove(next(mark for mark in self._told if mark.seat == most))

    def taken(self, seat: SeatNumber, theirs: int) -> Mark | None:
        """Return this one of a person's, None where it is new; a client repeats it until it is told."""
        return self._taken.get(seat, {}).get(theirs)

    def begin(self, seat: SeatNumber) -> None:
        """Begin with another client in a seat, which numbers its markers from 1: earlier ones are not taken for its own.

        Nor does an earlier marker that everybody holds on make it begin.
        """
        self._taken.pop(seat, None)
        told = [mark for mark in self._told if mark.seat is not None or mark.text != EVERYBODY]
        self._told = deque([replace(mark, theirs=0) if mark.seat == seat else mark for mark in told])

    def since(self, step: int) -> Sequence[Mark]:
        """Return those that were set at this step or later, oldest first, as far as they are still told."""
        return [mark for mark in self._told if mark.step >= step] if self._told else ()

    def due(self, step: int) -> Sequence[Mark]:
        """Return what is to be told after this step."""
        if not self._told:
            return ()
        while self._told and step - self._told[0].step > self._steps:
            self._told.popleft()
        return [mark for mark in self._told if (step - mark.step) % self._every == 0 or step == mark.step + 1]
