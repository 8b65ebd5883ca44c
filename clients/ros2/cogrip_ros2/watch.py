"""`ros2 run cogrip_ros2 watch LINK`: publish a session, the object and each hand, under CRTK names.

object/measured_cp, object/measured_cv   where the object is, and how it moves
NAME/measured_cp, NAME/measured_cf       where a hand is, and the force on it (measured_cf: that the device applies, -F)

NAME is the person's name as far as a topic may have it: letters of ASCII, digits and single underscores, with p before a digit.
"""

import re
import sys
from typing import Any

from cogrip.api import ApiError, Frame, watch
from cogrip.machine.stop import Stop
from cogrip_ros2.interrupted import on_interrupt


class SessionTopics:
    """Publishers of one session, made as people come."""

    def __init__(self, node: Any) -> None:
        from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped

        self._node = node
        self._types = {"measured_cp": PoseStamped, "measured_cv": TwistStamped, "measured_cf": WrenchStamped}
        self._publishers: dict[str, Any] = {}
        self._places: dict[str, str] = {}  # namespace of each person, by name

    def publish(self, frame: Frame) -> None:
        """Publish one view."""
        stamp = self._node.get_clock().now().to_msg()
        self._put("object/measured_cp", stamp, frame.object_m)
        self._put("object/measured_cv", stamp, frame.object_mps)
        for name, hand in frame.hands.items():
            place = self._place(name)
            self._put(f"{place}/measured_cp", stamp, hand.position_m)
            self._put(f"{place}/measured_cf", stamp, tuple(-force for force in hand.force_n))

    def _place(self, name: str) -> str:
        """Return the namespace of a person: no two have the same, and nobody the object's."""
        if name not in self._places:
            plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "person"
            plain = f"p{plain}" if plain[0].isdigit() else plain
            taken = {*self._places.values(), "object"}
            number = next(number for number in range(1, len(taken) + 2) if _numbered(plain, number) not in taken)
            self._places[name] = _numbered(plain, number)
        return self._places[name]

    def _put(self, topic: str, stamp: Any, values: tuple[float, ...]) -> None:
        kind = topic.rpartition("/")[2]
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(self._types[kind], topic, 1)
        message = self._types[kind]()
        message.header.stamp, message.header.frame_id = stamp, "cogrip"
        parts = {
            "measured_cp": ("pose", "position"),
            "measured_cv": ("twist", "linear"),
            "measured_cf": ("wrench", "force"),
        }
        outer, inner = parts[kind]
        vector = getattr(getattr(message, outer), inner)
        vector.x, vector.y, vector.z = (*values, 0.0, 0.0)[:3]
        self._publishers[topic].publish(message)


def _numbered(place: str, number: int) -> str:
    return place if number == 1 else f"{place}_{number}"


def main(arguments: list[str] | None = None) -> int:
    """Publish until a signal or the session's end. Returns the exit code."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    words = rclpy.utilities.remove_ros_args(sys.argv)[1:] if arguments is None else arguments
    if len(words) != 1:
        print("watch: give one join link, or HOST:PORT on this machine", file=sys.stderr)
        return 2
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, stop = rclpy.create_node("cogrip_watch"), Stop()

    def end() -> None:
        stop.reason = "interrupted"

    try:
        with on_interrupt(end) as came:
            watch(words[0], SessionTopics(node).publish, stop=stop)
        return 128 + came[0] if came else 0
    except ApiError as error:
        node.get_logger().error(str(error))
        return 1
    finally:
        rclpy.try_shutdown()
