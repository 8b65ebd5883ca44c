"""Stand-ins for rclpy and geometry_msgs: nodes in one process whose topics are lists of subscribers."""

import threading
from collections import defaultdict
from functools import partial
from types import SimpleNamespace
from typing import Any


def stamped(outer: str, *inner: str) -> Any:
    """Return a message with a header, that holds these vectors."""
    vectors = {name: SimpleNamespace(x=0.0, y=0.0, z=0.0) for name in inner}
    return SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id=""),
        **{outer: SimpleNamespace(**vectors)},
    )


MESSAGES = {
    "PoseStamped": partial(stamped, "pose", "position"),
    "TwistStamped": partial(stamped, "twist", "linear", "angular"),
    "WrenchStamped": partial(stamped, "wrench", "force", "torque"),
}


class Ros:
    """One graph. subscribers: by topic; said: what loggers wrote; shut: set at shutdown."""

    def __init__(self) -> None:
        self.subscribers: dict[str, list[Any]] = defaultdict(list)
        self.said: list[str] = []
        self.shut = threading.Event()

    def node(self, name: str) -> Any:
        logger = SimpleNamespace(info=self.said.append, error=self.said.append)
        now = SimpleNamespace(to_msg=lambda: "now")
        return SimpleNamespace(
            create_publisher=lambda kind, topic, depth: SimpleNamespace(
                publish=lambda message: self.publish(topic, message)
            ),
            create_subscription=lambda kind, topic, callback, depth: self.subscribers[topic].append(callback),
            get_logger=lambda: logger,
            get_clock=lambda: SimpleNamespace(now=lambda: now),
        )

    def publish(self, topic: str, message: Any) -> None:
        for callback in self.subscribers[topic]:
            callback(message)

    def modules(self) -> dict[str, Any]:
        """Return what stands in for the packages, by name."""
        messages = SimpleNamespace(**MESSAGES)
        rclpy = SimpleNamespace(
            init=lambda signal_handler_options: None, create_node=self.node, spin=lambda node: self.shut.wait(),
            try_shutdown=self.shut.set,
        )  # fmt: skip
        return {
            "rclpy": rclpy, "rclpy.executors": SimpleNamespace(ExternalShutdownException=KeyboardInterrupt),
            "rclpy.signals": SimpleNamespace(SignalHandlerOptions=SimpleNamespace(NO=0)),
            "rclpy.qos": SimpleNamespace(QoSProfile=SimpleNamespace, ReliabilityPolicy=SimpleNamespace(BEST_EFFORT=0)),
            "geometry_msgs": SimpleNamespace(msg=messages), "geometry_msgs.msg": messages,
        }  # fmt: skip
