"""The nodes of `cogrip_ros2` on ROS 2's own wire: real processes, each a DDS participant of its own, on this machine alone.

rclpy is a stand-in over Cyclone DDS; arm and listener know nothing of it.
"""

import json
import os
import signal
from collections.abc import Callable
from itertools import pairwise
from math import isfinite
from pathlib import Path
from typing import Any

import pytest

from cogrip.results.reading.records import open_run

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel here")
from tests.clients import dds_arm, dds_listener, dds_messages, ros_over_dds
from tests.extent import long
from tests.live.held_arms import DEMO

# Two loops, a server and threads of DDS share a small machine: such a session often stalls there, alone as well.
pytestmark = pytest.mark.long

LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


class Graph:
    """Processes of one domain of DDS. `Process` is that of `run`."""

    def __init__(self, run: Callable[..., Any], folder: Path, domain: int) -> None:
        self._run, self._folder, self._domain = run, folder, domain
        self._nodes: list[Any] = []  # of which none may stall while another one is waited for

    def node(self, program: str, *arguments: str) -> Any:
        self._nodes.append(self._run(program, self._domain, *arguments, code=ros_over_dds.PROGRAM))
        return self._nodes[-1]

    def arm(self, **orders: Any) -> Any:
        orders |= {"domain": self._domain, "namespace": "MTML", "left": str(self._folder / "arm.json")}
        arm = self._run(json.dumps(orders), code=dds_arm.PROGRAM)
        arm.company = self._nodes
        arm.hear("the arm is there")
        return arm

    def listener(self, *topics: str, name: str = "listener", **orders: Any) -> Any:
        orders |= {"domain": self._domain, "topics": topics, "left": str(self._folder / f"{name}.json")}
        listener = self._run(json.dumps(orders), code=dds_listener.PROGRAM)
        listener.company = self._nodes
        listener.hear("the listener is there")
        return listener

    def left(self, process: Any, name: str) -> Any:
        """End a process, and return all that it heard."""
        process.signal(signal.SIGTERM)
        assert process.end() == 0, process.said
        return json.loads((self._folder / f"{name}.json").read_text())


@pytest.fixture
def graph(run: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Graph:
    """A domain that no other test process of this machine has, on loopback."""
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    return Graph(run, tmp_path, 1 + os.getpid() % 100)


@pytest.fixture
def place(run: Callable[..., Any], serve: Callable[..., Any], tmp_path: Path) -> str:
    """The address of a session in which ben holds the cube."""
    _, port = serve(DEMO, "--set", "rates.device_hz=512")  # an arm that publishes more often misses no tick
    place = f"127.0.0.1:{port}"
    ben = run("join", place, "--name", "ben", "--device", "sim:phantom?hand=hold", "--runs", tmp_path / "ben")
    ben.hear("ben holds cube")
    return place


def hold(graph: Graph, place: str, *flags: str) -> Any:
    node = graph.node("hold", place, "--arm", "MTML", "--name", "anna", "--no-trial", "--damping-nspm", "25", *flags)
    node.hear("anna holds")
    return node


@pytest.mark.parametrize("best_effort", [True, long(False)], ids=["best effort", "reliable"])
def test_an_arm_holds_the_object_and_a_listener_hears_of_it(
    graph: Graph, place: str, tmp_path: Path, best_effort: bool
) -> None:
    topics = "object/measured_cp", "object/measured_cv", "anna/measured_cp", "anna/measured_cf"
    listener = graph.listener(*topics)
    late = graph.listener("object/measured_cp", name="late", transient_local=True)
    watch = graph.node("watch", place)
    arm = graph.arm(best_effort=best_effort)
    holder = hold(graph, place, "--folder", str(tmp_path))
    arm.hear("1000 forces read")
    for topic in topics:
        listener.hear(f"50 of {topic}")
    holder.signal(signal.SIGINT)
    assert holder.end() == 128 + signal.SIGINT, holder.said
    felt = graph.left(arm, "arm")
    heard = graph.left(listener, "listener")
    watch.signal(signal.SIGTERM)
    assert watch.end() == 128 + signal.SIGTERM, watch.said

    forces = [force_n for _, force_n in felt["read"]]
    published = int(holder.hear(r"published MTML/servo_cf: (\d+)")[1])
    print(f"servo_cf: {len(forces)} of {published}")
    assert max(map(abs, forces)) > 0.2, "ben is felt"
    assert forces[-1] == 0.0, "the last thing that an arm is told at Ctrl-C"
    assert 0.9 * published <= len(forces) <= published
    stamps = [stamp_ns for stamp_ns, _ in felt["read"]]
    assert all(one < next_ for one, next_ in pairwise(stamps)), "in order, none twice"

    read = open_run(tmp_path / "client-anna.mcap").clients["anna"].columns("tick", "position_m")["position_m"][:, 0]
    taken = [place_m for place_m in read.tolist() if isfinite(place_m)]
    sent = iter(felt["sent"])
    assert all(place_m in sent for place_m in taken), "the numbers that were sent, in their order"
    print(f"measured_cp: {len(taken)} of {len(felt['sent'])} sent, in {len(read)} ticks")
    assert len(taken) > 0.5 * len(read)

    for topic in topics:
        (told_ns, frames, _) = zip(*heard[topic], strict=True)
        assert all(one < next_ for one, next_ in pairwise(told_ns)), topic
        assert {*frames} == {"cogrip"}
        told = int(watch.hear(rf"published {topic}: (\d+)")[1])
        print(f"{topic}: {len(told_ns)} of {told}")
    assert "refused object/measured_cp" in late.said
    assert graph.left(late, "late") == {"object/measured_cp": []}, "it asks for messages that nobody keeps"


FAULTS = {
    "nan": "not finite", "silent": "more than 20 ms without samples", "stuck": "more than 20 ms without samples",
    "dies": "more than 20 ms without samples",
}  # fmt: skip
"""Reason of the end, by the arm's fault."""
MOST_TICKS = 30  # A force ends within so many ticks of 512 Hz: 20 ms without a sample, 15 ms of fading out, rounded up.


@pytest.mark.parametrize("fault", [long("silent"), long("stuck"), "nan", long("dies")])
def test_the_force_goes_to_zero_after_the_last_good_sample(graph: Graph, place: str, fault: str) -> None:
    listener = graph.listener("MTML/measured_cp", "MTML/servo_cf")
    arm = graph.arm(fault=fault, fault_after=700)
    listener.hear("matched MTML/measured_cp")
    holder = hold(graph, place)
    arm.hear("the fault begins")
    assert holder.end() == 1, holder.said
    assert FAULTS[fault] in holder.said
    if fault != "dies":
        arm.signal(signal.SIGTERM)
    arm.end()
    heard = graph.left(listener, "listener")
    good_ns = max(stamp for stamp, _, (x, _, _) in heard["MTML/measured_cp"] if isfinite(x))
    forces = [x for stamp, _, (x, _, _) in heard["MTML/servo_cf"]]
    after = [x for stamp, _, (x, _, _) in heard["MTML/servo_cf"] if stamp > good_ns]
    assert after, "what a silent arm is told"
    print(f"{fault}: |F| {abs(after[0]):.2f} N, {sum(map(bool, after))} ticks until it is zero, {len(after)} in all")
    assert max(map(abs, forces)) > 0.2, "ben is felt before"
    assert sum(map(bool, after)) <= MOST_TICKS
    assert after[-1] == 0.0


@pytest.mark.long
def test_a_node_that_is_killed_leaves_the_others_their_session(graph: Graph, place: str) -> None:
    listener = graph.listener("object/measured_cp", "ben/measured_cf")
    graph.node("watch", place)
    arm = graph.arm()
    holder = hold(graph, place)
    arm.hear("500 forces read")
    holder.signal(signal.SIGKILL)
    holder.end()
    graph.left(arm, "arm")
    listener.hear("matched object/measured_cp")
    again = graph.arm()
    back = hold(graph, place)
    again.hear("500 forces read")
    back.signal(signal.SIGINT)
    assert back.end() == 128 + signal.SIGINT, back.said
    felt = graph.left(again, "arm")
    assert felt["read"][-1][1] == 0.0
    assert graph.left(listener, "listener")["ben/measured_cf"]


def test_messages_are_encoded_as_ros_2_encodes_them() -> None:
    rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
    for kind in (dds_messages.PoseStamped, dds_messages.TwistStamped, dds_messages.WrenchStamped):
        message = kind()
        message.header.stamp, message.header.frame_id = dds_messages.Time(5, 6), "cogrip"
        encoded = message.serialize()
        name = f"geometry_msgs/msg/{kind.__name__}"
        assert bytes(store.serialize_cdr(store.deserialize_cdr(encoded, name), name)) == encoded
        assert store.deserialize_cdr(encoded, name).header.frame_id == "cogrip"
        assert kind.__idl_typename__ == f"geometry_msgs::msg::dds_::{kind.__name__}_"
