"""Sessions of hands that turn: a wheel for two, tools that tumble in a scene and in another author's world, hands that only
move in a room of poses."""

from math import degrees, hypot
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from cogrip.cli.settings.settings_file import load
from cogrip.protocol.laws.rotations import between, exp
from cogrip.protocol.settings.room import SettingsError, resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds import orientation_drift
from cogrip.server.worlds.guarded import GuardedWorld
from cogrip.server.worlds.registry import ALLOWED
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.sim.laboratory import Laboratory

from tests.extent import long
from tests.sim.session_measures import allowed

Array = NDArray[np.float64]
HZ = 128
LOSSY = ("link.loss=0.03",)
EMPTY = '<mujoco><option gravity="0 0 0"/><worldbody>{}</worldbody></mujoco>'
BOX = '<body name="thing" pos="0 0 {}"><freejoint/><geom type="box" size=".02 .02 .02" mass=".1"/></body>'
TURNS = 7
TUMBLING = "waypoints&" + "&".join(
    f"{key}={','.join(map(str, values))}"
    for key, values in (
        ("times_s", [0.5 + 0.7 * number for number in range(TURNS)]),
        ("rx_rad", [(0.0, 1.5, 1.5, 0.0)[number % 4] for number in range(TURNS)]),
        ("ry_rad", [(0.0, 0.0, 1.5, 1.5)[number % 4] for number in range(TURNS)]),
        ("rz_rad", [(0.0, 1.0)[number % 2] for number in range(TURNS)]),
    )
)
TUMBLER = {"device": "sim:freeflyer", "hand": TUMBLING}
TUMBLED: dict[str, object] = {"link": {"delay_ms": 20.0, "loss": 0.03}, "seconds": 2.0 + 0.7 * TURNS}


class Turned:
    """A session, and after each frame: angle between each hand and its tool, drift of each tool [degrees]."""

    def __init__(self, settings: Settings) -> None:
        self.laboratory = Laboratory(settings)
        world = self.laboratory.room.world
        assert isinstance(world, SceneWorld | GuardedWorld)
        self.world = world
        apart: list[list[float]] = []
        drift: list[list[float]] = []

        def each_frame(laboratory: Laboratory) -> None:
            users = [user for user in world.turning.driven if world.holding[user]]
            hands = [laboratory.people[user].core.position_m[3:] for user in users]
            tools = [world.proxy(user)[3:] for user in users]
            apart.append([degrees(hypot(*between(exp(a), exp(b)))) for a, b in zip(hands, tools, strict=True)])
            drift.append([degrees(hypot(*world.turning.drift[user].drift_rad)) for user in users])

        self.laboratory.run(None, each_frame)
        count = max(map(len, apart))
        self.apart, self.drift = (np.array([row for row in rows if len(row) == count]) for rows in (apart, drift))

    def passive(self) -> bool:
        """Return whether every ledger is above 0: of lines, device ends, and the limiter, which has not acted."""
        limiter = self.world.limiter
        seats = [self.laboratory.room.seat_account(number) for number in range(len(self.laboratory.people))]
        ends = [person.core.port.account() for person in self.laboratory.people]
        lines = min(seat.line_margin_j for seat in seats) + allowed("line_margin_j") >= -1e-12
        device_ends = min(end.margin_j or 0.0 for end in ends) >= 0.0
        return lines and device_ends and limiter.limited == 0 and limiter.level_j >= 0.0


def of_scene(folder: Path, body: str, *people: dict[str, object], **more: object) -> Settings:
    (folder / "scene.xml").write_text(EMPTY.format(body))
    thing = {"kind": "scene", "file": str(folder / "scene.xml"), "axes": 6}
    users = [{"name": f"p{number}", **person} for number, person in enumerate(people)]
    return resolve({"object": thing, "users": users, **more})


def wheel(stop_s: float, *overrides: str) -> Settings:
    """Return the settings of a wheel that is turned up to a time, and then held for two seconds more."""
    hands = [user.hand for user in load(Path("wheel")).users]
    stopped = [f"users.{number}.hand={hand}&stop_s={stop_s}" for number, hand in enumerate(hands)]
    return load(Path("wheel"), (*stopped, f"seconds={stop_s + 4.0}", *overrides))


@pytest.mark.parametrize(("stop_s", "overrides"), [(2.0, LOSSY), long(5.0, ())])
def test_two_people_turn_a_wheel(stop_s: float, overrides: tuple[str, ...]) -> None:
    session = Turned(wheel(stop_s, *overrides))
    assert not session.laboratory.incident
    assert all(person.core.safety.state == "live" for person in session.laboratory.people)
    assert session.drift.max() <= 0.01
    assert session.apart.max() <= 3.0, "at 3 rad/s a hand is ahead by 0.17 degrees each ms"
    assert session.apart[-1].max() <= 0.5, "at rest"
    assert session.passive()
    assert session.world.balance_error_j <= 1e-14
    turned = exp(session.world.proxy(0)[3:])
    assert 2.0 * np.arctan2(turned[3], turned[0]) % (2.0 * np.pi) == pytest.approx(
        3.0 * (stop_s - 1.0) % (2.0 * np.pi), abs=0.02
    )


@pytest.mark.long
def test_two_people_turn_a_wheel_for_half_a_minute_over_a_lossy_line() -> None:
    session = Turned(wheel(30.0, *LOSSY))
    assert session.drift.max() <= 0.01
    assert session.apart[-1].max() <= 0.5
    assert session.passive()


@pytest.fixture(scope="module")
def tumbled(tmp_path_factory: pytest.TempPathFactory) -> Turned:
    folder = tmp_path_factory.mktemp("tumbling")
    return Turned(of_scene(folder, BOX.format("0.3"), TUMBLER, **TUMBLED))


@pytest.mark.long
def test_a_tool_that_tumbles_stays_with_its_hand(tumbled: Turned) -> None:
    assert tumbled.drift.max() <= 1.0
    assert tumbled.apart[-1, 0] <= 0.1, "at rest"
    assert tumbled.passive()


@pytest.mark.long
def test_so_does_one_in_a_world_of_another_author(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drift is taken back there as well; a hand that took hold turned goes on from there."""
    monkeypatch.setenv(ALLOWED, str(tmp_path))
    (tmp_path / "world.py").write_text("from tests.server.broken_worlds import Tumbling")
    thing = {"kind": f"python:{tmp_path / 'world.py'}:Tumbling", "axes": 6}
    session = Turned(resolve({"object": thing, "users": [TUMBLER], **TUMBLED}))
    assert session.drift.max() <= 1.0
    assert session.apart[-1, 0] <= 0.1, "at rest"
    assert session.passive()


@pytest.mark.long
def test_without_the_correction_it_drifts(monkeypatch: pytest.MonkeyPatch, tumbled: Turned) -> None:
    monkeypatch.setattr(orientation_drift, "SHARE", 0.0)
    drifted = Turned(tumbled.laboratory.settings)
    assert drifted.apart[-1, 0] >= 0.3
    assert drifted.passive()


@pytest.mark.long
@pytest.mark.parametrize("orientation", ["free", long("damped"), long("fixed")])
def test_a_hand_that_does_not_turn_holds_a_tool_in_a_room_of_poses(orientation: str, tmp_path: Path) -> None:
    """Both press on a box from the side; the pads of a free tool turn as they like, those of a fixed one not at all."""
    squeeze = "waypoints&times_s=0.2,1&x_m=0,{}"
    settings = of_scene(
        tmp_path, BOX.format("0"),
        {"device": "sim:ideal", "hand": squeeze.format("0.06"), "orientation": orientation},
        {"device": "sim:freeflyer", "hand": squeeze.format("-0.06"), "side": "right"},
        seconds=3.0, link={"delay_ms": 5.0},
    )  # fmt: skip
    laboratory = Laboratory(settings)
    laboratory.run()
    world = laboratory.room.world
    assert isinstance(world, SceneWorld)
    assert [len(person.core.force_n) for person in laboratory.people] == [3, 6]
    assert not laboratory.incident
    assert laboratory.people[0].core.force_n[0] == pytest.approx(laboratory.people[1].core.force_n[0] * -1.0, abs=0.05)
    assert laboratory.people[0].core.force_n[0] > 1.0
    assert world.scene.tools[0].turns == (orientation != "fixed")
    assert world.limiter.limited == 0


def test_devices_that_do_not_turn_are_told_how_to_join(tmp_path: Path) -> None:
    settings = of_scene(tmp_path, BOX.format("0"), {"device": "sim:ideal"})
    with pytest.raises(Exception, match=r"sim:ideal.*axes"):
        Laboratory(settings).run()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"object": {"axes": 6}}, 'object.axes = 6, but object.kind = "cube" has at most 3; lower it'),
        ({"object": {"kind": "my-world", "axes": 5}}, "object.axes = 5, but a world has 1 to 3 .places. or 6 .poses."),
        (
            {"object": {"kind": "my-world", "axes": 6}, "users": [{"orientation": "free"}]},
            'is for object.kind = "scene"',
        ),
        ({"users": [{"orientation": "free"}]}, "users.0.orientation = 'free' is for object.kind = \"scene\""),
        (
            {"object": {"kind": "scene", "file": "x", "axes": 3}, "users": [{"orientation": "driven"}]},
            "set object.axes = 6",
        ),
        ({"object": {"kind": "scene", "file": "x", "axes": 6}, "playout": {"redundancy": 17}}, "set it to at most 13"),
    ],
)
def test_settings_that_do_not_fit(change: dict[str, object], said: str) -> None:
    with pytest.raises(SettingsError, match=said):
        resolve(change)
