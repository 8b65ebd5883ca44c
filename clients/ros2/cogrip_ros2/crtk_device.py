"""A cogrip device that is a ROS 2 arm with CRTK names.

    subscribed   measured_cp   geometry_msgs/PoseStamped    position of the handle [m]
                 measured_cv   geometry_msgs/TwistStamped   its velocity [m/s], where `gives_velocity`
    published    servo_cf      geometry_msgs/WrenchStamped  force that the arm applies to the hand [N], each tick

cogrip's F loads the hand (the device pushes with -F), CRTK's servo_cf is the force that the arm applies: servo_cf = -F. Frames
are the arm's own. Callbacks run in the executor's thread, the loop in another: they share references that are replaced whole.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from cogrip.api import Capability, DeviceError, Sample
from cogrip.devices.device import check_rate

LOST_S = 0.1  # time without a measured_cp after which the arm is lost


class CrtkDevice:
    """A `Device`. node: an rclpy Node whose executor spins in another thread; record: the arm's limits."""

    def __init__(self, node: Any, record: Capability, name: str = "") -> None:
        from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

        prefix = f"{name}/" if name else ""
        self.capability = record
        self.counts: Mapping[str, int] = Counter()
        self._wrench = WrenchStamped
        self._node = node
        self._pose: tuple[float, float, float] | None = None  # newest, None once it was read
        self._twist: tuple[float, float, float] | None = None
        self._rate_hz = self._pose_tick = self._begun = 0
        self._publisher = node.create_publisher(WrenchStamped, f"{prefix}servo_cf", 1)
        node.create_subscription(PoseStamped, f"{prefix}measured_cp", self._on_pose, 1)
        if record.gives_velocity:
            node.create_subscription(TwistStamped, f"{prefix}measured_cv", self._on_twist, 1)

    def _on_pose(self, message: Any) -> None:
        at = message.pose.position
        self._pose = at.x, at.y, at.z

    def _on_twist(self, message: Any) -> None:
        speed = message.twist.linear
        self._twist = speed.x, speed.y, speed.z

    def open(self, rate_hz: int) -> None:
        if self._rate_hz:
            raise DeviceError("crtk: is open already; close it first")
        check_rate(rate_hz, self.capability, "crtk")
        self._rate_hz, self._pose_tick, self._pose = rate_hz, -1, None

    def read(self, tick: int) -> Sample | None:
        if not self._rate_hz:
            raise DeviceError("crtk: read while it is closed; call open(rate_hz) first")
        if self._pose_tick < 0:
            self._pose_tick = tick  # the arm has LOST_S from the first tick on
        pose, self._pose = self._pose, None
        axes, twist = self.capability.axes, self._twist
        if pose is None or (self.capability.gives_velocity and twist is None):
            if tick - self._pose_tick > LOST_S * self._rate_hz:
                raise DeviceError(
                    f"crtk: no measured_cp for {LOST_S:g} s; see that the arm's node runs, and its namespace"
                )
            return None
        self._pose_tick = tick
        return Sample(pose[:axes], twist[:axes] if self.capability.gives_velocity and twist else None, 1)

    def write(self, force_n: Sequence[float]) -> None:
        if not self._rate_hz:
            raise DeviceError("crtk: write while it is closed; call open(rate_hz) first")
        if len(force_n) != self.capability.axes:
            raise DeviceError(f"crtk: write of {len(force_n)} forces to {self.capability.axes} axes")
        if not all(map(isfinite, force_n)):
            self._publish((0.0,) * len(force_n))
            raise DeviceError(f"crtk: write of {force_n} N: not finite; zero is sent instead")
        self._publish(force_n)

    def close(self) -> None:
        if self._rate_hz:
            self._rate_hz = 0
            self._publish((0.0,) * self.capability.axes)

    def _publish(self, force_n: Sequence[float]) -> None:
        message = self._wrench()
        message.header.stamp = self._node.get_clock().now().to_msg()
        pushed = message.wrench.force
        pushed.x, pushed.y, pushed.z = [-force for force in (*force_n, 0.0, 0.0)[:3]]
        self._publisher.publish(message)
