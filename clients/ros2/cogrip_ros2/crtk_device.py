"""A cogrip device that is a ROS 2 arm with CRTK names.

    subscribed   measured_cp   geometry_msgs/PoseStamped    position of the handle [m]
                 measured_cv   geometry_msgs/TwistStamped   its velocity [m/s], where `gives_velocity`
    published    servo_cf      geometry_msgs/WrenchStamped  force that the arm applies to the hand [N], each tick

cogrip's F loads the hand (the device pushes with -F), CRTK's servo_cf is the force that the arm applies: servo_cf = -F. Frames
are the arm's own. Callbacks run in the executor's thread, the loop in another: they share references that are replaced whole.
A message counts once and if it is newer than the one before, as its stamp has it; one without a stamp (0) always counts.
"""

from collections import Counter
from collections.abc import Sequence
from math import isfinite
from typing import Any

from cogrip.api import Capability, DeviceError, Sample
from cogrip.devices.device import check_rate

LOST_S = 0.1  # time without a measured_cp after which the arm is lost
VELOCITY_S = 0.01  # time for which a measured_cv counts


class CrtkDevice:
    """A `Device`. node: an rclpy Node whose executor spins in another thread; record: the arm's limits."""

    def __init__(self, node: Any, record: Capability, name: str = "") -> None:
        from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        # Best effort takes what reliable publishers and best-effort ones send; reliable would get nothing of the latter.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        prefix = f"{name}/" if name else ""
        self.capability = record
        self.counts: Counter[str] = Counter()
        self._wrench = WrenchStamped
        self._node = node
        self._pose: tuple[float, float, float] | None = None  # newest, None once it was read
        self._twist: tuple[float, float, float] | None = None
        self._velocity: tuple[float, float, float] | None = None  # the twist that was read last
        self._pose_ns = self._twist_ns = 0  # stamps of the newest
        self._rate_hz = self._pose_tick = self._twist_tick = 0
        self._publisher = node.create_publisher(WrenchStamped, f"{prefix}servo_cf", 1)
        node.create_subscription(PoseStamped, f"{prefix}measured_cp", self._on_pose, newest)
        if record.gives_velocity:
            node.create_subscription(TwistStamped, f"{prefix}measured_cv", self._on_twist, newest)

    def _on_pose(self, message: Any) -> None:
        stamp_ns, at = _stamp_ns(message), message.pose.position
        if not all(map(isfinite, (at.x, at.y, at.z))):
            self.counts["measured_cp that is no number"] += 1
            return
        if stamp_ns and stamp_ns <= self._pose_ns:
            self.counts["measured_cp that is no newer"] += 1
            return
        self._pose_ns, self._pose = stamp_ns, (at.x, at.y, at.z)

    def _on_twist(self, message: Any) -> None:
        stamp_ns, speed = _stamp_ns(message), message.twist.linear
        if not all(map(isfinite, (speed.x, speed.y, speed.z))):
            self.counts["measured_cv that is no number"] += 1
            return
        if stamp_ns and stamp_ns <= self._twist_ns:
            self.counts["measured_cv that is no newer"] += 1
            return
        self._twist_ns, self._twist = stamp_ns, (speed.x, speed.y, speed.z)

    def open(self, rate_hz: int) -> None:
        if self._rate_hz:
            raise DeviceError("crtk: is open already; close it first")
        check_rate(rate_hz, self.capability, "crtk")
        self._pose = self._twist = self._velocity = None  # nothing of an opening before is this one's
        self._rate_hz, self._pose_tick, self._twist_tick = rate_hz, -1, 0

    def read(self, tick: int) -> Sample | None:
        if not self._rate_hz:
            raise DeviceError("crtk: read while it is closed; call open(rate_hz) first")
        if self._pose_tick < 0:
            self._pose_tick = tick  # the arm has LOST_S from the first tick on
        pose, self._pose = self._pose, None
        twist, self._twist = self._twist, None
        if twist is not None:
            self._velocity, self._twist_tick = twist, tick
        elif tick - self._twist_tick > VELOCITY_S * self._rate_hz:
            self._velocity = None
        axes, velocity, wanted = self.capability.axes, self._velocity, self.capability.gives_velocity
        if pose is None or (wanted and velocity is None):
            if tick - self._pose_tick > LOST_S * self._rate_hz:
                topic = "measured_cp" if pose is None else "measured_cv"
                raise DeviceError(
                    f"crtk: no {topic} for {LOST_S:g} s that is newer than the last; "
                    "see that the arm's node runs, its namespace, and that its stamps go on"
                )
            return None
        self._pose_tick = tick
        return Sample(pose[:axes], velocity[:axes] if wanted and velocity else None, 1)

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


def _stamp_ns(message: Any) -> int:
    """Return when a message was made [ns], 0 where it does not say."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
