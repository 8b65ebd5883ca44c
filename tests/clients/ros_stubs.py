"""Stand-ins for rclpy and geometry_msgs: nodes in one process whose topics are lists of subscribers."""

import threading
from collections import defaultdict
from types import ModuleType, SimpleNamespace
from typing import Any


class Vector:
    def __init__(self) -> None:
        self.x = self.y = self.z = 0.0


class Stamped:
    """A message with a header; `parts` says what it holds."""

    parts: tuple[str, tuple[str, ...]] = ("", ())

    def __init__(self) -> None:
        self.header = SimpleNamespace(stamp=None, frame_id="")
        outer, inner = self.parts
        setattr(self, outer, SimpleNamespace(**{name: Vector() for name in inner}))


class PoseStamped(Stamped):
    parts = "pose", ("position",)


class TwistStamped(Stamped):
    parts = "twist", ("linear", "angular")


class WrenchStamped(Stamped):
    parts = "wrench", ("force", "torque")


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

    def modules(self) -> dict[str, ModuleType]:
        """Return what stands in for the packages, by name."""
        rclpy, messages, package = ModuleType("rclpy"), ModuleType("geometry_msgs.msg"), ModuleType("geometry_msgs")
        rclpy.init = lambda: None  # type: ignore[attr-defined]
        rclpy.create_node = self.node  # type: ignore[attr-defined]
        rclpy.spin = lambda node: self.shut.wait()  # type: ignore[attr-defined]
        rclpy.try_shutdown = self.shut.set  # type: ignore[attr-defined]
        for kind in (PoseStamped, TwistStamped, WrenchStamped):
            setattr(messages, kind.__name__, kind)
        package.msg = messages  # type: ignore[attr-defined]
        return {"rclpy": rclpy, "geometry_msgs": package, "geometry_msgs.msg": messages}
