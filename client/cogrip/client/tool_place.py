"""Places of one seat: of the hand and of its tool, as the device has them and in lengths."""

from collections.abc import Sequence

from cogrip.client.hand_frame import HandFrame
from cogrip.client.hand_motion import HandMotion
from cogrip.client.pose_axes import PoseAxes, Row
from cogrip.protocol.setting_types import PLACES


class ToolPlace:
    """Base of a seat, which sets what is named here."""

    hand: HandMotion
    force_n: Row
    _axes: PoseAxes | None  # None: nothing turns
    _frame: HandFrame | None  # None: the tool moves as the hand
    _origin_m: Row | None  # of the line

    @property
    def pose(self) -> Row:
        """Position of the hand [m], and rotation vector [rad]."""
        position = self.hand.position_m
        return position if self._axes is None else self._axes.pose(position)

    @property
    def twist(self) -> Sequence[float]:
        """Velocity of the hand [m/s], and angular velocity [rad/s]."""
        velocity = self.hand.velocity_mps
        return velocity if self._axes is None else self._axes.rates(velocity)

    @property
    def wrench(self) -> Row:
        """Force [N] and torque [N m] of this tick, shape (axes,)."""
        return self.force_n if self._axes is None else self._axes.wrench(self.force_n)

    def tool_m(self) -> Row:
        """Return the tool's place, in lengths."""
        position = self.hand.position_m
        return position if self._frame is None else self._frame.place(position)

    def tool_pose(self) -> Row:
        """Return the tool's position [m], and rotation vector [rad]."""
        frame, pose = self._frame, self.pose
        if frame is None:
            return pose
        place = frame.place(self.hand.position_m)
        return place if self._axes is None else place[:PLACES] + frame.rotation(pose[PLACES:])

    def place(self) -> Row:
        """Return the tool's pose, and of one that turns also the angle travelled since the line's beginning."""
        if self._axes is None:
            return self.tool_m()
        assert self._origin_m is not None
        moved = [at - begun for at, begun in zip(self.tool_m(), self._origin_m, strict=True)]
        return self.tool_pose() + self._axes.rates(moved)[PLACES:]
