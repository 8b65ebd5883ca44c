"""Feel of a hand at rest: its stiffness as measured, and what softens the one that it is to feel."""

from collections import deque
from collections.abc import Sequence
from operator import mul

from cogrip.client.coupling.interface import Coupling
from cogrip.client.hand.felt_stiffness import REST_S, FeltStiffness
from cogrip.client.hand.frame import HandFrame
from cogrip.machine.addition import add_floats
from cogrip.machine.rows import Row
from cogrip.protocol.settings.seat import SeatSettings


class RestFeel:
    """Frames of a hand whose force is let through.

    deficit_frames  position deficit of the line in each of the last ones, by which it is softer
    felt            stiffness at the tool, None where nothing stands still
    """

    __slots__ = ("_side", "deficit_frames", "felt")

    def __init__(self, seat: SeatSettings, resolution_m: float) -> None:
        frame_s = seat.rates.frame_s
        self._side = seat.side_sign
        self.felt = FeltStiffness(resolution_m, frame_s) if seat.holds_still else None
        self.deficit_frames: deque[float] = deque(maxlen=max(2, round(REST_S / frame_s)))

    def set_resolution(self, resolution_m: float) -> None:
        """Set the device's resolution of position [m]."""
        if self.felt is not None:
            self.felt.resolution_m = resolution_m

    def enter(self, coupling: Coupling, frame: HandFrame, position_m: Row, force_n: Sequence[float]) -> None:
        """Enter a frame that ended. position_m, force_n: of the hand at its end, the force without that of sources."""
        self.deficit_frames.append(max(0.0, coupling.deficit_frames))
        if self.felt is not None:
            force_n = frame.tool_force(force_n)
            depth, direction = coupling.pressed or (self._side * frame.place(position_m)[0], (self._side,))
            self.felt.add(depth, add_floats(map(mul, direction, force_n)))

    def mean_deficit_frames(self) -> float:
        """Return the mean of `deficit_frames`; 0 before the first."""
        return add_floats(self.deficit_frames) / max(1, len(self.deficit_frames))

    def stiffness_npm(self) -> float | None:
        """Return the stiffness at the tool that was felt at rest [N/m]; None where it was not measured."""
        return self.felt.stiffness_npm() if self.felt else None
