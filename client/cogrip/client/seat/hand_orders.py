"""Orders for one person in the session: the frame in which the hand moves its tool (theory 1.1), its clutch, limit and weight,
the line and the spring (theory 7.3).

A change waits for a frame's border, where nothing of a frame is on its way into the line: the energy ledger then splits
between two ticks, exactly (`WorkAccount.set_power_ratio`). Places of hand and tool stay, and the force ramps in anew.
"""

from typing import NamedTuple

from cogrip.client.hand.frame import HandFrame
from cogrip.client.hand.hand_map import HandMap
from cogrip.client.hand_changes import TakenChanges
from cogrip.client.sources.hand_aids import HandAids
from cogrip.machine.rows import Row
from cogrip.protocol.settings.hand import UNSET, HandChange
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.tool_frame import ToolFrame
from cogrip.protocol.wire.messages import SetHand


class Applied(NamedTuple):
    """Parts of a seat that are others now: the frame of the tool, the force that the device adds, line and spring."""

    tool: bool
    aids: bool
    line: HandChange | None


NOTHING = Applied(False, False, None)


class HandOrders:
    """Orders that wait for a border, and reports of what holds.

    frame    of the hand; places and forces of the coupling are in that of the tool
    waiting  change that the next frame's border applies, None for none
    changes  those that the server told, and reports to it
    line     what holds of line and spring of what was changed; its owner sets it
    """

    def __init__(self, seat: SeatSettings, aids: HandAids) -> None:
        self._seat, self._axes = seat, seat.object.axes
        self._aids = aids
        self.line = UNSET
        self.frame = HandFrame() if seat.tool is None else HandMap(seat.tool, self._axes)
        self.waiting: HandChange | None = None
        self.changes = TakenChanges(seat.hand_change)

    def clutch(self, held: bool) -> None:
        """Hold the clutch, or release it: from the next tick on."""
        self._mapped().asked = held

    def order(self, change: HandChange) -> None:
        """Have a change apply from the end of the frame under way."""
        self.waiting = change if self.waiting is None else change.after(self.waiting)

    def receive(self, message: SetHand) -> None:
        """Receive a change from the server, once; one that does not fit this hand is refused in the next report."""
        change = self.changes.receive(message)
        if change is not None:
            self.order(HandChange() if self._seat.unfit_change(change) else change)

    def holds(self) -> HandChange:
        """Return what holds now, as it is reported."""
        tool, aids = self.frame.tool, self._aids
        hand = HandChange(
            tool.position_scale, tool.force_scale, tool.rotation, self.frame.held, aids.limit, aids.carries
        )
        return hand if self.line is UNSET else self.line.after(hand)

    def apply(self, position_m: Row, pose: Row) -> Applied:
        """Apply what waits, with the hand here, at a frame's border. Return what of the hand is another one now."""
        change, self.waiting = self.waiting, None
        if change is None:
            return NOTHING
        tool = change.frame(self.frame.tool if self.frame.mapped else None)
        changed = tool != self.frame.tool
        if changed:
            self._mapped().change(tool, position_m, pose)
        aided = change.workspace_limit_m is not None or change.gravity_compensation is not None
        if aided:
            self._aids.change(change)
        if change.clutch is not None:
            self.clutch(change.clutch)
        return Applied(changed, aided, change if change.of_line() else None)

    def hold(self, buttons: int, position_m: Row, pose: Row) -> None:
        """Hold or release the clutch as it is asked, by its button or else, with the hand here."""
        frame = self.frame
        if isinstance(frame, HandMap):
            frame.hold(frame.asked or bool(buttons & frame.button), position_m, pose)

    def report(self, changed: bool) -> None:
        """Report what holds, at a frame's border, where it has changed."""
        if changed or (self.frame.mapped and self.holds() != self.changes.holds):
            self.changes.report(self.holds())

    def _mapped(self) -> HandMap:
        """Return the frame, as one that can be changed."""
        if not isinstance(self.frame, HandMap):
            self.frame = HandMap(ToolFrame(), self._axes)
        return self.frame
