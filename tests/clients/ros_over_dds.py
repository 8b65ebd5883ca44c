"""A stand-in for rclpy over Cyclone DDS: its topics, types and qualities of service are those of ROS 2 on the wire.

`run` is a node of `cogrip_ros2` in this process: `code=PROGRAM` of a test's process, with the program's name, the domain and
the program's arguments; at its end it prints how much it published. As in rclpy, `init` takes SIGINT and SIGTERM over where it
is not told otherwise, and nothing can be published once they came.
"""

import importlib
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NoReturn

from cyclonedds.core import InstanceState, Listener, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tests.clients import dds_messages

ROOT = Path(__file__).parents[2]
PROGRAM = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from tests.clients.ros_over_dds import run; run()"
PACKAGE = ROOT / "clients" / "ros2"
TOPIC = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
LOOKED_MS = 50  # time from one look at the shutdown to the next


class ReliabilityPolicy(Enum):
    RELIABLE = "reliable"
    BEST_EFFORT = "best effort"


class SignalHandlerOptions(Enum):
    ALL = "both"
    NO = "neither"


class ExternalShutdownException(Exception):  # noqa: N818 - rclpy's name
    """Raised by `spin` once the context was shut down by somebody else."""


class QoSProfile:
    """Keeps the last `depth` messages; the rest as rclpy has it where nothing is said: reliable and volatile."""

    def __init__(self, *, depth: int, reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE) -> None:
        self.depth, self.reliability = depth, reliability


def quality(wanted: QoSProfile | int) -> Qos:
    """Return a profile as DDS has it; a number is the depth."""
    profile = QoSProfile(depth=wanted) if isinstance(wanted, int) else wanted
    reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
    return Qos(
        reliable if profile.reliability is ReliabilityPolicy.RELIABLE else Policy.Reliability.BestEffort,
        Policy.Durability.Volatile,
        Policy.History.KeepLast(profile.depth),
    )


class Publisher:
    def __init__(self, context: threading.Event, topic: str, writer: DataWriter) -> None:
        self.topic, self.published = topic, 0
        self._context, self._writer = context, writer

    def publish(self, message: Any) -> None:
        if self._context.is_set():
            raise RuntimeError("Failed to publish: the context is shut down")
        self._writer.write(message)
        self.published += 1


class Node:
    """A participant of the domain that ROS_DOMAIN_ID names."""

    def __init__(self, context: threading.Event, name: str, domain: int) -> None:
        self.context = context
        self.participant = DomainParticipant(domain)
        self.publishers: list[Publisher] = []
        self.subscriptions: list[tuple[DataReader, Callable[[Any], None]]] = []
        self._name = name

    def create_publisher(self, kind: Any, topic: str, wanted: QoSProfile | int) -> Publisher:
        writer = DataWriter(self.participant, self._topic(kind, topic), quality(wanted))
        self.publishers.append(Publisher(self.context, topic, writer))
        return self.publishers[-1]

    def create_subscription(
        self, kind: Any, topic: str, callback: Callable[[Any], None], wanted: QoSProfile | int
    ) -> None:
        def refused(reader: Any, status: Any) -> None:
            self._say(f"New publisher discovered on topic '/{topic}', offering incompatible QoS.")

        listener = Listener(on_requested_incompatible_qos=refused)
        reader = DataReader(self.participant, self._topic(kind, topic), quality(wanted), listener)
        self.subscriptions.append((reader, callback))

    def get_logger(self) -> Any:
        return SimpleNamespace(info=self._say, error=self._say)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=now))

    def _topic(self, kind: Any, topic: str) -> Topic:
        assert TOPIC.fullmatch(topic) and "__" not in topic, f"{topic!r} is no topic"  # noqa: PT018
        return Topic(self.participant, f"rt/{topic}", kind)

    def _say(self, text: str) -> None:
        print(f"[{self._name}] {text}", flush=True)


def now() -> dds_messages.Time:
    sec, nanosec = divmod(time.time_ns(), 10**9)
    return dds_messages.Time(sec, nanosec)


class Context:
    """State of the process: what `init` and `try_shutdown` change. shut: set at the shutdown."""

    def __init__(self, domain: int) -> None:
        self.shut = threading.Event()
        self.nodes: list[Node] = []
        self._domain = domain

    def init(self, *, signal_handler_options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
        if signal_handler_options is SignalHandlerOptions.NO:
            return
        for number in (signal.SIGINT, signal.SIGTERM):
            before = signal.getsignal(number)

            def handle(number: int, frame: Any, before: Any = before) -> None:
                self.shut.set()
                if callable(before):
                    before(number, frame)

            signal.signal(number, handle)

    def create_node(self, name: str) -> Node:
        self.nodes.append(Node(self.shut, name, self._domain))
        return self.nodes[-1]

    def spin(self, node: Node) -> NoReturn:
        """Call callbacks until the shutdown. Raises ExternalShutdownException then."""
        waits = WaitSet(node.participant)
        new = SampleState.NotRead | ViewState.Any | InstanceState.Alive
        for reader, _ in node.subscriptions:
            waits.attach(ReadCondition(reader, new))
        while not self.shut.is_set():
            waits.wait(duration(milliseconds=LOOKED_MS))
            for reader, callback in node.subscriptions:
                for message in reader.take(N=16):
                    if isinstance(message, dds_messages.IdlStruct):  # else the end of its writer
                        callback(message)
        raise ExternalShutdownException


def put_in_place(context: Context) -> None:
    """Let `import rclpy` and `import geometry_msgs.msg` find what stands in for them."""
    names = ("PoseStamped", "TwistStamped", "WrenchStamped")
    parts: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": context.init,
            "create_node": context.create_node,
            "spin": context.spin,
            "try_shutdown": context.shut.set,
        },
        "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
        "rclpy.qos": {"QoSProfile": QoSProfile, "ReliabilityPolicy": ReliabilityPolicy},
        "rclpy.signals": {"SignalHandlerOptions": SignalHandlerOptions},
        "rclpy.utilities": {"remove_ros_args": lambda arguments: arguments},
        "geometry_msgs": {},
        "geometry_msgs.msg": {name: getattr(dds_messages, name) for name in names},
    }
    for name, content in parts.items():
        module = sys.modules[name] = ModuleType(name)
        module.__dict__.update(content)
        if "." in name:
            parent, _, child = name.rpartition(".")
            setattr(sys.modules[parent], child, module)


def run() -> NoReturn:
    """Run the program of the package that the first argument names, in the domain that the second does, with the others."""
    program, domain, *arguments = sys.argv[1:]
    sys.path.insert(0, str(PACKAGE))
    context = Context(int(domain))
    put_in_place(context)
    sys.argv = [program, *arguments]
    code = importlib.import_module(f"cogrip_ros2.{program}").main()
    for publisher in (each for node in context.nodes for each in node.publishers):
        print(f"published {publisher.topic}: {publisher.published}", flush=True)
    sys.exit(code)
