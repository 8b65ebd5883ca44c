"""The ROS 2 example package against stand-ins for rclpy: no ROS is here."""

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import pytest

import cogrip.api as cogrip

from tests.clients.ros_stubs import MESSAGES, Ros

PACKAGE = Path(__file__).parents[2] / "clients" / "ros2"


@pytest.fixture
def ros(monkeypatch: pytest.MonkeyPatch) -> Iterator[Ros]:
    graph = Ros()
    monkeypatch.syspath_prepend(str(PACKAGE))
    for name, module in graph.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    yield graph
    graph.shut.set()
    for name in [name for name in sys.modules if name.startswith("cogrip_ros2")]:
        del sys.modules[name]


def make_device(ros: Ros, *flags: str) -> Any:
    from cogrip_ros2.crtk_device import CrtkDevice  # type: ignore[import-not-found]
    from cogrip_ros2.hold import parse, record  # type: ignore[import-not-found]

    return CrtkDevice(ros.node("test"), record(parse(["127.0.0.1", *flags])), "MTML")


@pytest.fixture
def pushed(ros: Ros) -> list[Any]:
    """Return the list of the arm's forces."""
    found: list[Any] = []
    ros.subscribers["MTML/servo_cf"].append(found.append)
    return found


def pose(x: float, y: float = 0.0, z: float = 0.0) -> Any:
    message = MESSAGES["PoseStamped"]()
    message.pose.position = SimpleNamespace(x=x, y=y, z=z)
    return message


def test_an_arm_is_read_once_a_message_and_pushed_with_the_opposite_sign(ros: Ros, pushed: list[Any]) -> None:
    device = make_device(ros)
    device.open(1024)
    assert device.read(0) is None
    ros.publish("MTML/measured_cp", pose(0.01, 0.02, 0.03))
    assert device.read(1) == cogrip.Sample((0.01, 0.02, 0.03), None, 1)
    assert device.read(2) is None
    device.write((1.0, -2.0, 0.5))
    device.close()
    forces = [(each.wrench.force.x, each.wrench.force.y, each.wrench.force.z) for each in pushed]
    assert forces == [(-1.0, 2.0, -0.5), (0.0, 0.0, 0.0)]
    assert pushed[0].header.stamp == "now"


def test_velocity_is_used_where_it_is_asked_for(ros: Ros) -> None:
    device = make_device(ros, "--velocity")
    device.open(1024)
    ros.publish("MTML/measured_cp", pose(0.01))
    assert device.read(0) is None, "no velocity yet"
    twist = MESSAGES["TwistStamped"]()
    twist.twist.linear.y = 0.5
    ros.publish("MTML/measured_cv", twist)
    ros.publish("MTML/measured_cp", pose(0.01))
    assert device.read(1) == cogrip.Sample((0.01, 0.0, 0.0), (0.0, 0.5, 0.0), 1)


def test_a_message_counts_once_and_if_it_is_newer_than_the_one_before(ros: Ros) -> None:
    device = make_device(ros)
    device.open(1024)
    for tick, (nanosec, counts) in enumerate([(5, True), (5, False), (4, False), (6, True), (0, True), (3, True)]):
        message = pose(0.01)
        message.header.stamp.nanosec = nanosec
        ros.publish("MTML/measured_cp", message)
        assert (device.read(tick) is not None) is counts, nanosec
    assert device.counts == {"measured_cp that is no newer": 2}


def test_a_velocity_counts_for_a_hundredth_of_a_second(ros: Ros) -> None:
    device = make_device(ros, "--velocity")
    device.open(1024)
    twist = MESSAGES["TwistStamped"]()
    twist.twist.linear.x = 0.5
    ros.publish("MTML/measured_cv", twist)
    for tick in range(200):
        ros.publish("MTML/measured_cp", pose(0.01))
        if tick <= 10:
            assert device.read(tick) == cogrip.Sample((0.01, 0.0, 0.0), (0.5, 0.0, 0.0), 1)
        elif tick <= 10 + 102:
            assert device.read(tick) is None
        else:
            break
    with pytest.raises(cogrip.DeviceError, match=r"no measured_cv for 0\.1 s that is newer"):
        device.read(tick)


def test_a_velocity_of_an_opening_before_is_none_of_this_one(ros: Ros) -> None:
    device = make_device(ros, "--velocity")
    twist = MESSAGES["TwistStamped"]()
    twist.twist.linear = SimpleNamespace(x=0.5, y=0.0, z=0.0)
    device.open(512)
    device.read(0)
    ros.publish("MTML/measured_cp", pose(0.01))
    ros.publish("MTML/measured_cv", twist)
    assert device.read(5000).velocity_mps == (0.5, 0.0, 0.0)
    device.close()
    device.open(512)
    for tick in range(3):
        ros.publish("MTML/measured_cp", pose(0.01))
        assert device.read(tick) is None, "no velocity has come yet"


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_what_is_no_number_is_no_sample(ros: Ros, wrong: float) -> None:
    device = make_device(ros, "--velocity")
    twist = MESSAGES["TwistStamped"]()
    twist.twist.linear = SimpleNamespace(x=0.0, y=wrong, z=0.0)
    device.open(512)
    ros.publish("MTML/measured_cp", pose(wrong))
    ros.publish("MTML/measured_cv", twist)
    assert device.read(0) is None
    assert device.counts == {"measured_cp that is no number": 1, "measured_cv that is no number": 1}


def test_people_are_topics_of_their_own_whatever_they_are_called(ros: Ros) -> None:
    from cogrip_ros2.watch import SessionTopics  # type: ignore[import-not-found]

    topics = SessionTopics(ros.node("test"))
    names = ["anna", "Ben 2", "Ben-2", "2nd", "Ünal", "___", "object", "anna"]
    places = ["anna", "Ben_2", "Ben_2_2", "p2nd", "nal", "person", "object_2", "anna"]
    assert [topics._place(name) for name in names] == places


def test_a_silent_arm_is_lost_and_a_wrong_force_becomes_none(ros: Ros, pushed: list[Any]) -> None:
    device = make_device(ros)
    with pytest.raises(cogrip.DeviceError, match="closed"):
        device.read(0)
    device.open(1024)
    device.read(5000)
    assert device.read(5000 + 102) is None
    with pytest.raises(cogrip.DeviceError, match=r"no measured_cp for 0\.1 s"):
        device.read(5000 + 103)
    with pytest.raises(cogrip.DeviceError, match="not finite"):
        device.write((float("nan"), 0.0, 0.0))
    assert pushed[-1].wrench.force.x == 0.0
    with pytest.raises(cogrip.DeviceError, match="2 forces to 3 axes"):
        device.write((0.0, 0.0))


def test_a_session_is_published_under_crtk_names(ros: Ros) -> None:
    from cogrip_ros2.watch import SessionTopics  # type: ignore[import-not-found]

    seen: dict[str, Any] = {}
    for topic in ("object/measured_cp", "object/measured_cv", "anna/measured_cp", "ben_2/measured_cf"):
        ros.subscribers[topic].append(lambda message, topic=topic: seen.update({topic: message}))
    topics, frames = SessionTopics(ros.node("test")), list[cogrip.Frame]()
    for on_frame in (topics.publish, frames.append):
        cogrip.run("demo", seconds=0.1, users={1: {"name": "ben 2"}}, on_frame=on_frame)
    last = frames[-1]
    assert seen["object/measured_cp"].pose.position.x == last.object_m[0]
    assert seen["object/measured_cv"].twist.linear.x == last.object_mps[0]
    assert seen["anna/measured_cp"].pose.position.x == last.hands["anna"].position_m[0]
    assert seen["ben_2/measured_cf"].wrench.force.x == -last.hands["ben 2"].force_n[0]
    assert seen["anna/measured_cp"].header.frame_id == "cogrip"


@pytest.mark.long
def test_an_arm_holds_the_object_of_a_live_session(ros: Ros, tmp_path: Path) -> None:
    """The stand-in is an arm of 0.3 kg in a hand that pulls to and fro; each servo_cf makes its next measured_cp."""
    arm = {"x": 0.0, "v": 0.0, "ticks": 0.0}

    def step(message: Any) -> None:
        arm["ticks"] += 1.0
        rest = 0.02 if arm["ticks"] % 2048 > 1024 else 0.0
        force = message.wrench.force.x + 300.0 * (rest - arm["x"]) - 10.0 * arm["v"]
        arm["v"] += force / 0.3 / 1024
        arm["x"] += arm["v"] / 1024
        ros.publish("MTML/measured_cp", pose(arm["x"]))

    device = make_device(ros, "--damping-nspm", "25")
    ros.subscribers["MTML/servo_cf"].append(step)
    users = {1: {"hand": "hold"}}
    with cogrip.Session(
        "demo", mine=["anna"], seconds=2.0, folder=tmp_path, object={"axes": 3}, users=users
    ) as session:
        session.client("anna", device)
        ros.publish("MTML/measured_cp", pose(0.0))
        run = session.wait()
    assert run.good, run.summary
    assert arm["ticks"] > 1024
    assert abs(run.columns("anna", "force_n")["force_n"][:, 0]).max() > 0.2


def test_the_programs_end_with_the_reason(ros: Ros, capsys: pytest.CaptureFixture[str]) -> None:
    from cogrip_ros2 import hold, watch  # type: ignore[import-not-found]

    assert hold.main(["127.0.0.1:1", "--arm", "MTML"]) == 1
    assert any("no measured_cp" in text for text in ros.said), ros.said  # the motors are tried before the seat is taken
    assert hold.main(["127.0.0.1:1", "--arm", "MTML", "--no-trial"]) == 1
    assert any("no server" in text or "refused" in text for text in ros.said), ros.said
    assert watch.main([]) == 2
    assert "give one join link" in capsys.readouterr().err


def test_the_package_names_its_programs() -> None:
    assert ElementTree.parse(PACKAGE / "package.xml").findtext("name") == "cogrip_ros2"
    programs = {path.stem for path in (PACKAGE / "cogrip_ros2").glob("*.py") if "def main" in path.read_text()}
    setup = (PACKAGE / "setup.py").read_text()
    assert programs == {"hold", "watch"}
    assert all(f"{name} = cogrip_ros2.{name}:main" in setup for name in programs)
