"""Bags of ROS 2: read back by `rosbags`, and as MCAP by its own strict reader; every number as recorded, to the last bit."""

import math
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from cogrip.cli.main import main
from cogrip.client.recorder import client_topics
from cogrip.protocol.recording.header import Header, versions_here
from cogrip.protocol.recording.records import Tick
from cogrip.protocol.recording.sink import encode
from cogrip.protocol.settings.room import resolve
from cogrip.results.reading.bag import export_bag, namespaces
from cogrip.results.reading.records import RunRecords, open_run
from cogrip.results.writing.laboratory_run import run_laboratory

from tests.cli.command import Cogrip
from tests.recording_files import written

rosbags = pytest.importorskip("rosbags.highlevel", reason="the extra rosbag2 is not installed")
SETTINGS: dict[str, Any] = {
    "name": "short", "seconds": 0.5, "object": {"axes": 2}, "link": {"delay_ms": 10, "loss": 0.1},
    "users": [{"name": "anna", "hand": "reach"}, {"name": "Ben 2", "hand": "hold"}],
}  # fmt: skip
Read = dict[str, list[tuple[int, Any]]]


def read(folder: Path) -> Read:
    """Return stamp and message of all messages by topic, and assert that they come in the order of their stamps."""
    found: Read = {}
    last_ns = 0
    with rosbags.AnyReader([folder]) as reader:
        for connection, time_ns, raw in reader.messages():
            assert time_ns >= last_ns
            last_ns = time_ns
            found.setdefault(connection.topic, []).append((time_ns, reader.deserialize(raw, connection.msgtype)))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made: Path = tmp_path_factory.mktemp("run")
    run_laboratory(resolve(SETTINGS), made)
    export_bag(open_run(made), made)
    return made


@pytest.fixture(scope="module")
def bag(folder: Path) -> Read:
    return read(folder / "rosbag2")


@pytest.fixture(scope="module")
def recorded(folder: Path) -> RunRecords:
    return open_run(folder)


def xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def test_hands_are_those_of_the_recording(bag: Read, recorded: RunRecords) -> None:
    for name, place in (("anna", "anna"), ("Ben 2", "Ben_2")):
        ticks = [tick for _, tick in recorded.clients[name].records("tick")]
        times_ns = [
            message.time_ns
            for message in recorded.clients[name].recording.messages()
            if message.topic == recorded.clients[name].topic("tick")
        ]
        for topic, of in (("measured_cp", "position_m"), ("measured_cv", "velocity_mps"), ("measured_cf", "force_n")):
            messages = bag[f"/{place}/{topic}"]
            assert len(messages) == len(ticks)
            for (time_ns, message), tick, recorded_ns in zip(messages, ticks, times_ns, strict=True):
                assert time_ns == stamp_ns(message) == recorded_ns
                assert message.header.frame_id == place
                sign = -1.0 if of == "force_n" else 1.0
                part = {"measured_cp": "pose.position", "measured_cv": "twist.linear", "measured_cf": "wrench.force"}[
                    topic
                ]
                outer, inner = part.split(".")
                x, y = getattr(tick, of)
                assert xyz(getattr(getattr(message, outer), inner)) == (sign * x, sign * y, 0.0)
    assert [message.data for _, message in bag["/anna/state"]] == ["live"]


def test_object_proxies_and_events_are_those_of_the_server(bag: Read, recorded: RunRecords) -> None:
    assert recorded.server is not None
    steps = [step for _, step in recorded.steps()]
    assert [xyz(message.pose.position)[:2] for _, message in bag["/object/measured_cp"]] == [
        step.object_m for step in steps
    ]
    assert [xyz(message.twist.linear)[:2] for _, message in bag["/object/measured_cv"]] == [
        step.object_mps for step in steps
    ]
    for seat, place in enumerate(("anna", "Ben_2")):
        rows = [step.seats[seat] for step in steps if step.seats[seat].seated]
        assert [xyz(each.pose.position)[:2] for _, each in bag[f"/{place}/proxy/measured_cp"]] == [
            row.proxy_m for row in rows
        ]
        assert [xyz(each.wrench.force)[:2] for _, each in bag[f"/{place}/proxy/measured_cf"]] == [
            row.force_n for row in rows
        ]
    texts = [event.text for _, event in recorded.server.records("event")]
    assert [message.data for _, message in bag["/events"]] == texts


def test_metadata_and_storage_are_what_ros2_bag_of_jazzy_takes(folder: Path, bag: Read) -> None:
    from ruamel.yaml import YAML  # rosbags brings it

    said = YAML(typ="safe").load((folder / "rosbag2" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (said["version"], said["storage_identifier"], said["relative_file_paths"]) == (9, "mcap", ["rosbag2.mcap"])
    counts = {each["topic_metadata"]["name"]: each["message_count"] for each in said["topics_with_message_count"]}
    assert counts == {topic: len(messages) for topic, messages in bag.items()}
    assert said["message_count"] == sum(counts.values())
    times = [time_ns for messages in bag.values() for time_ns, _ in messages]
    assert said["starting_time"]["nanoseconds_since_epoch"] == min(times)
    assert said["duration"]["nanoseconds"] == max(times) - min(times)
    with (folder / "rosbag2" / "rosbag2.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        found: Counter[str] = Counter()
        for schema, channel, _ in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            found[channel.topic] += 1
        assert found == counts


def test_axes_that_turn_and_a_gripper(tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    for name, place, force in (
        ("anna", (0.1, 0.2, 0.3, 0.0, 0.0, math.pi / 2), (1.0, 2.0, 3.0, 0.4, 0.5, 0.6)),
        ("ben", (0.1, 0.2, 0.3, 0.05), (1.0, 2.0, 3.0, 4.0)),
    ):
        head = Header("client", name, "{}", 1024, 1, 7 * 10**9, False, versions_here(), client_topics(name))
        rows = dict.fromkeys(("velocity_mps", "wave_up", "wave_down", "object_m"), place)
        tick = {"late_us": 0, "work_us": 0, "work_j": 0.0, "port_j": 0.0, "force_n": force, **rows}
        with written(tmp_path / f"client-{name}.mcap", head) as writer:
            topic = next(number for number, topic in enumerate(head.topics) if topic.endswith("/tick"))
            writer.put(topic, 10, encode(Tick(tick=0, position_m=place, **tick)))
            writer.put(topic, 20, encode(Tick(tick=1, position_m=None, **tick)))
    export_bag(open_run(tmp_path), tmp_path)
    bag = read(tmp_path / "rosbag2")
    ((time_ns, pose),) = bag["/anna/measured_cp"]
    assert time_ns == 7 * 10**9 + 10
    turned = pose.pose.orientation
    assert (turned.w, turned.x, turned.y, turned.z) == pytest.approx((half, 0.0, 0.0, half))
    wrench = bag["/anna/measured_cf"][0][1].wrench
    assert xyz(wrench.force) == (-1.0, -2.0, -3.0)
    assert xyz(wrench.torque) == (-0.4, -0.5, -0.6)
    ((_, joint),) = bag["/ben/gripper/measured_js"]
    assert (joint.name, *joint.position, *joint.velocity, *joint.effort) == (["opening"], 0.05, 0.05, -4.0)


def test_names_become_namespaces_that_ros_takes() -> None:
    names = ["anna", "Ben 2", "Ben-2", "2nd", "Ünal", "___", "object"]
    assert list(namespaces(names).values()) == ["anna", "Ben_2", "Ben_2_2", "p2nd", "nal", "person", "object_2"]


def test_a_bag_is_written_once_and_the_command_says_what_is_missing(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cogrip = Cogrip(main, capsys)
    code, _, said = cogrip("export", folder, "--to", "rosbag2")
    assert code == 2
    assert "rosbag2 exists, and nothing is overwritten" in " ".join(said.split())
    code, out, _ = cogrip("export", folder, "--to", "rosbag2", "--out", tmp_path / "again")
    assert code == 0
    assert re.search(r"rosbag2: \d+ messages", " ".join(out.split()))
    assert "there is no bag of datagrams" in cogrip("export", folder, "--to", "rosbag2", "--datagrams")[2]
    monkeypatch.setitem(sys.modules, "rosbags", None)
    code, _, said = cogrip("export", folder, "--to", "rosbag2", "--out", tmp_path / "none")
    assert code == 2
    assert "pip install 'cogrip[rosbag2]'" in said
    assert not (tmp_path / "none").exists()
