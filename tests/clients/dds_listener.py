"""A listener to topics of ROS 2, by Cyclone DDS alone, as `ros2 topic echo` is one.

`run` is a process of its own: `code=PROGRAM`, with its orders as JSON text. It prints `matched TOPIC` as a writer is found, and
`refused TOPIC` where one offers less than it asks for. Once it is ended by SIGTERM it writes a file: of each topic the stamp
[ns], the frame and the vector of each message, in the order of their coming.
"""

import json
import signal
import sys
from pathlib import Path
from typing import Any

import msgspec
from cyclonedds.core import InstanceState, Listener, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tests.clients.dds_messages import PoseStamped, TwistStamped, WrenchStamped

ROOT = Path(__file__).parents[2]
PROGRAM = f"import sys; sys.path.insert(0, {str(ROOT)!r}); from tests.clients.dds_listener import run; run()"
LOOKED_MS = 50  # time from one look at the signal to the next
KINDS: dict[str, tuple[Any, str, str]] = {
    "measured_cp": (PoseStamped, "pose", "position"),
    "measured_cv": (TwistStamped, "twist", "linear"),
    "measured_cf": (WrenchStamped, "wrench", "force"),
    "servo_cf": (WrenchStamped, "wrench", "force"),
}
"""Type, and where the vector is, by the last part of the topic."""


class Orders(msgspec.Struct):
    domain: int
    topics: list[str]
    left: str  # file of all that was heard
    best_effort: bool = False  # what it asks for
    transient_local: bool = False  # asks for messages of before it was there


def run() -> None:
    orders = msgspec.json.decode(sys.argv[1], type=Orders)
    ended: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
    participant = DomainParticipant(orders.domain)
    reliable = Policy.Reliability.Reliable(duration(milliseconds=100))
    wanted = Qos(
        Policy.Reliability.BestEffort if orders.best_effort else reliable,
        Policy.Durability.TransientLocal if orders.transient_local else Policy.Durability.Volatile,
        Policy.History.KeepAll,
    )
    readers = {name: _reader(participant, name, wanted) for name in orders.topics}
    waits = WaitSet(participant)
    for reader in readers.values():
        waits.attach(ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Alive))
    heard: dict[str, list[Any]] = {name: [] for name in orders.topics}
    print("the listener is there", flush=True)
    while not ended:
        waits.wait(duration(milliseconds=LOOKED_MS))
        for name, reader in readers.items():
            kind, outer, inner = KINDS[name.rpartition("/")[2]]
            for message in reader.take(N=64):
                if isinstance(message, kind):
                    stamp, vector = message.header.stamp, getattr(getattr(message, outer), inner)
                    row = stamp.sec * 10**9 + stamp.nanosec, message.header.frame_id, [vector.x, vector.y, vector.z]
                    heard[name].append(row)
                    if len(heard[name]) % 50 == 0:
                        print(f"{len(heard[name])} of {name}", flush=True)
    Path(orders.left).write_text(json.dumps(heard))


def _reader(participant: DomainParticipant, name: str, wanted: Qos) -> DataReader:
    def matched(reader: Any, status: Any) -> None:
        if status.current_count_change > 0:
            print(f"matched {name}", flush=True)

    def refused(reader: Any, status: Any) -> None:
        print(f"refused {name}", flush=True)

    listener = Listener(on_subscription_matched=matched, on_requested_incompatible_qos=refused)
    topic = Topic(participant, f"rt/{name}", KINDS[name.rpartition("/")[2]][0])
    return DataReader(participant, topic, wanted, listener)
