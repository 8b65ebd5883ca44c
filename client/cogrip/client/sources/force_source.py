"""Forces at a hand beside its coupling's: what a source of one is, and the sum of those of a seat (theory 1.2, 7.8).

A new source is a class that gives a `force`, and its place among the `ForceSources` that `SeatedClient` makes. Device port and
safety limit the sum of all: no source need know what they do to it, beyond the part that acted.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cogrip.client.hand.frame import HandFrame
from cogrip.client.rows.delay_line import DelayLine, mean_row
from cogrip.client.rows.springs import part_of
from cogrip.devices.device import Capability
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row


class AtHand(NamedTuple):
    """Hand and device in one tick, as a source sees them. Rows are shape (axes,), in lengths.

    tick, position_m, velocity_mps  of the hand
    frame         of the hand: where its tool is (`place`), and a tool's force at the hand (`hand_force`)
    gain          of the ramp of safety, as it will be in this tick
    carried_nspm  impedance that the device carries, at the tool
    carried_npm   stiffness that it carries there, for all sources together
    """

    tick: int
    position_m: Row
    velocity_mps: Sequence[float]
    frame: HandFrame
    gain: float
    carried_nspm: float
    carried_npm: float


class ForceSource(ABC):
    """One force at a hand; a subclass gives `force`. Its default accounts are those of a force that a line never sees.

    asked_n      force of this tick, before ramp and limits, shape (axes,); None where there is none
    acted_n      what acted of it in the ticks that were entered last; () for nothing
    local_n      part of `asked_n` that follows the hand's motion, which the detector of oscillation is to know; () none
    active_n     part of `asked_n` that follows time, which it is not to take for an oscillation; () none
    potential_j  what it has taken that it is bound to give back: counted as work at the device
    work_j       of the hand against it, where that is counted apart from what leaks
    reduced      whether less than was asked for is rendered, for the device's sake
    """

    def __init__(self, present: bool) -> None:
        self._present = present
        self.tell_change: Callable[[], None] = lambda: None  # called as `present` changes
        self.asked_n: Row | None = None
        self.acted_n: Sequence[float] = ()
        self.local_n: Sequence[float] = ()
        self.active_n: Sequence[float] = ()
        self.potential_j = self.work_j = 0.0
        self.reduced = False
        self._parts: DelayLine[Row] = DelayLine()

    @property
    def present(self) -> bool:
        """Return whether it may give force: else no tick asks it."""
        return self._present

    @present.setter
    def present(self, value: bool) -> None:
        if value != self._present:
            self._present = value
            self.tell_change()

    def fit(self, record: Capability, own: Capability, free_j: float) -> None:
        """Set the device. record: in lengths, own: with the units of each axis.

        free_j: what the device port lends before it does anything about it
        """
        self._parts.set_ticks(record.latency_ticks, (0.0,) * record.axes)

    @abstractmethod
    def force(self, at: AtHand) -> Row | None:
        """Return the force of a tick [N], shape (axes,), before ramp and limits; None for none."""

    def enter(
        self, elapsed: int, part: float, start_m: Sequence[float], end_m: Sequence[float] | None
    ) -> Sequence[float]:
        """Enter ticks of which the hand felt this part of `asked_n`, and a displacement that the samples show now.

        Return the mean of what acted of it in that displacement [N], shape (axes,); () for nothing.
        """
        return mean_row(self._parts, tuple([part * asked for asked in self.asked_n or (0.0,) * len(start_m)]), elapsed)

    def stored_j(self, position_m: Sequence[float]) -> float:
        """Return the energy in its springs."""
        return 0.0

    def begin_anew(self) -> None:
        """Render nothing from now on, and come again as if new: what springs held is lost."""
        self.asked_n = None

    def forget(self) -> None:  # noqa: B027 - most sources have nothing of a server
        """End what a server told: another line begins, perhaps of another server."""


class ForceSources:
    """All sources of one seat, in the order in which they are added.

    present      those that may give force now
    wish_n       force of the newest tick that had one, of coupling, sources and injected damping, before limits
    asked_n      the sources' part of it; None where they asked for nothing
    potential_j  of all; work_j as well
    """

    __slots__ = ("_all", "asked_n", "potential_j", "present", "reduced", "wish_n", "work_j")

    def __init__(self, *sources: ForceSource) -> None:
        self._all = sources
        for source in sources:
            source.tell_change = self._look
        self.wish_n: Sequence[float] = ()
        self.potential_j = self.work_j = 0.0
        self.reduced = False
        self._look()

    def _look(self) -> None:
        """Look which sources may give force from now on."""
        self.present = tuple([source for source in self._all if source.present])
        self.asked_n: Sequence[float] | None = None

    def fit(self, record: Capability, own: Capability, free_j: float) -> None:
        """Set the device, as `ForceSource.fit` does."""
        for source in self._all:
            source.fit(record, own, free_j)

    def begin_anew(self) -> None:
        """Have every source come again as if new."""
        for source in self.present:
            source.begin_anew()

    def forget(self) -> None:
        """Have every source end what a server told."""
        for source in self._all:
            source.forget()

    def added(self, own_n: Sequence[float], at: AtHand) -> Sequence[float]:
        """Return the coupling's force with that of all sources [N], shape (axes,)."""
        total = own_n
        self.asked_n, self.reduced = None, False
        for source in self.present:
            more = source.force(at)
            if more is not None:
                total = [a + b for a, b in zip(total, more, strict=True)]
                before: Sequence[float] | None = self.asked_n
                self.asked_n = more if before is None else [a + b for a, b in zip(before, more, strict=True)]
            self.reduced = self.reduced or source.reduced
        self.potential_j = add_floats([source.potential_j for source in self._all])
        return total

    def enter(
        self, elapsed: int, held_n: Row, acting_n: Sequence[float], start_m: Row, end_m: Row | None
    ) -> Sequence[float]:
        """Enter a displacement of the hand. Return the coupling's part of what acted in it.

        held_n: to the motors over these `elapsed` ticks; acting_n: while the hand moved so, where samples are old
        """
        # Where all of them cancel out the wish is next to 0, and the part is bounded
        part = min(1.0, max(0.0, part_of(held_n, self.wish_n))) if self.wish_n else 0.0
        for source in self.present:
            source.acted_n = acted = source.enter(elapsed, part, start_m, end_m)
            if acted:
                acting_n = [of_all - own for of_all, own in zip(acting_n, acted, strict=True)]
        self.work_j = add_floats([source.work_j for source in self._all])
        return acting_n

    def stored_j(self, position_m: Sequence[float]) -> float:
        """Return the energy in springs of all."""
        return add_floats([source.stored_j(position_m) for source in self.present])

    def rest_of(self, force_n: Sequence[float]) -> Sequence[float]:
        """Return a force without the sources' part of what acted last."""
        for source in self.present:
            if source.acted_n:
                force_n = [a - b for a, b in zip(force_n, source.acted_n, strict=True)]
        return force_n

    def watched(
        self, local_n: Sequence[float], force_n: Sequence[float], gain: float
    ) -> tuple[Sequence[float], Sequence[float]]:
        """Return for the detector of oscillation what follows the hand's motion, and the force less what follows time."""
        for source in self.present:
            if source.asked_n is not None and source.local_n:
                local_n = [a + b for a, b in zip(local_n, source.local_n, strict=True)]
            if source.asked_n is not None and source.active_n:
                force_n = [a - gain * b for a, b in zip(force_n, source.active_n, strict=True)]
        return local_n, force_n
