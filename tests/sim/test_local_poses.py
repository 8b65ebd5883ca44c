"""Local contact in scenes of six axes: what is felt, the first touch, free motion, a wall that jumps, margins, replay."""

from itertools import pairwise
from math import dist, hypot
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from cogrip.cli.settings.shipped_settings import shipped_scene
from cogrip.client.coupling.local.contact_spring import LENT_J, MOST_SAVED_J
from cogrip.protocol.laws.rotations import between, exp
from cogrip.protocol.recording.reader import open_recording
from cogrip.protocol.recording.records import Datagram
from cogrip.protocol.settings.network_profiles import PROFILES
from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.wire.messages import Geom, Waves, decode
from cogrip.results.reading.folder import SERVER_RECORDING
from cogrip.results.replay.verify import verify
from cogrip.results.verdict.verdict import passive
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.results.writing.summary import of_laboratory
from cogrip.server.room import Room
from cogrip.server.worlds.scenes.local_scene import LocalSceneWorld
from cogrip.sim.laboratory import Laboratory

from tests.extent import every, long
from tests.sim.session_measures import account_of, by_tick, laboratory_of

PRESS = "waypoints&times_s=1,1.4,2&x_m=0,0.1,0.1&rz_rad=0,0.3,0.3"  # onto the wall, whose face meets the ball at 80 mm
WALL_M = 0.08
SWING = "waypoints&times_s=0.3,0.8,1.4,2&x_m=0,0.06,-0.03,0.06&y_m=0,0.03,0,0&ry_rad=0,0.4,-0.2,0.3"
LIFT = "waypoints&times_s=0.5,1.5,2,3,4,5&x_m=0,{0},{1},{1},{1},0&z_m=0,0,0,0.05,0,0&{2}=0,0.4,0.4,-0.2,0,0"


def at_wall(
    network: str, stiffness_npm: float = 1000.0, hand: str = PRESS, file: Path | None = None, **more: object
) -> Laboratory:
    """Return a session in which a hand with a ball presses on a fixed wall, and turns."""
    thing = {"kind": "scene", "axes": 6, "file": str(file or shipped_scene("wall.xml"))}
    coupling = {"kind": "local", "stiffness_npm": stiffness_npm}
    users = [{"name": "anna", "tool": "ball", "device": "sim:phantom6", "hand": hand}]
    link = {"profile": network, "loss": 0.05}
    table = {"seconds": 3.2, "object": thing, "coupling": coupling, "link": link, "users": users}
    return laboratory_of(**{**table, **more})


@pytest.mark.sample(1)
@pytest.mark.parametrize("stiffness_npm", [200.0, long(1000.0), 3000.0])
@pytest.mark.parametrize("network", every(3, PROFILES))
def test_wall_feels_as_stiff_as_asked_on_every_network(network: str, stiffness_npm: float) -> None:
    laboratory = at_wall(network, stiffness_npm)
    account, core = account_of(laboratory), laboratory.people[0].core
    assert account.felt_stiffness_npm == pytest.approx(stiffness_npm, rel=0.03)
    assert account.peak_force_n > 2.0
    assert not account.device.oscillates
    assert account.device.margin_j >= 0.0
    assert core.position_m[0] - WALL_M == pytest.approx(core.force_n[0] / stiffness_npm, rel=1e-6)
    assert passive(of_laboratory(laboratory)).tone == "good"


@pytest.mark.long
@pytest.mark.parametrize("network", every(4, PROFILES))
def test_first_force_is_there_within_two_ticks_of_the_touch(network: str) -> None:
    laboratory = at_wall(network)
    core = laboratory.people[0].core
    rows = by_tick(laboratory, lambda _: (core.position_m[0] > WALL_M, any(core.force_n[:3])))
    touched, felt = ([row[which] for row in rows].index(True) for which in (0, 1))
    assert 0 <= felt - touched <= 2


@pytest.mark.long
@pytest.mark.parametrize("network", every(4, PROFILES))
def test_free_motion_feels_the_device_alone_and_turning_its_line(network: str) -> None:
    """No force at the places, so no mass; and the tool is where the hand is."""
    laboratory = at_wall(network, hand=SWING, seconds=4.0)
    world, core = laboratory.room.world, laboratory.people[0].core
    forces, tool_m = zip(*by_tick(laboratory, lambda _: (core.force_n, float(world.proxy(0)[0]))), strict=True)
    assert {force[:3] for force in forces} == {(0.0, 0.0, 0.0)}
    assert max(hypot(*force[3:]) for force in forces) > 0.01, "N/l of the line"
    assert isinstance(world, LocalSceneWorld)
    assert world.kinematic.all()
    assert max(tool_m) > 0.05
    assert world.proxy(0)[:3] == pytest.approx(core.seated.pose[:3], abs=1e-4)


@pytest.mark.long
@pytest.mark.parametrize("network", ["lan", long("wifi"), "wan", long("lte")])
def test_a_clear_tool_is_turned_as_its_hand(network: str) -> None:
    laboratory = at_wall(network, hand=SWING, seconds=5.0)
    laboratory.run()
    turned = laboratory.people[0].core.seated.pose[3:]
    assert hypot(*turned) > 0.2
    assert hypot(*between(exp(laboratory.room.world.proxy(0)[3:].tolist()), exp(turned))) < 0.01


@pytest.mark.long
def test_wall_that_jumps_into_the_hand_changes_the_force_little_and_gives_nothing(tmp_path: Path) -> None:
    """Another server goes on with the room, whose wall stands 20 mm nearer: inside of it is the hand that pressed on it."""
    file = tmp_path / "wall.xml"
    text = shipped_scene("wall.xml").read_text()
    file.write_text(text)
    hand = PRESS.replace("1,1.4,2&x_m=0,0.1,0.1", "1,1.4,3,3.5,4.5&x_m=0,0.1,0.1,0,0.07").replace(
        "0.3,0.3", "0.3,0.3,0.3,0.3"
    )
    laboratory = at_wall("wan", file=file, hand=hand, seconds=5.0)
    core = laboratory.people[0].core

    def move_wall() -> None:
        file.write_text(text.replace('pos=".08 0 0"', 'pos=".06 0 0"'))
        (checkpoint,) = laboratory.kill()
        another = Room(laboratory.settings)
        scene, coordinates = another.world.coordinates()
        laboratory.restart([replace(checkpoint, digest=another.digest, scene=scene, coordinates=coordinates)])

    places, forces = zip(
        *by_tick(laboratory, lambda _: (core.position_m[:3], core.force_n[:3]), {2400: move_wall})[2400:], strict=True
    )
    account = account_of(laboratory)
    assert forces[0][0] > 3.0, "it pressed"
    assert max(dist(after, before) for before, after in pairwise(forces)) <= 1.0
    works_j = np.cumsum((np.diff(places, axis=0) * forces[:-1]).sum(axis=1))
    assert works_j.min() >= -(MOST_SAVED_J + LENT_J)
    assert account.device.margin_j >= 0.0
    assert core.position_m[0] - (WALL_M - 0.02) == pytest.approx(core.force_n[0] / 1000.0, rel=1e-3), "of the new wall"


def lifting(network: str, seed: int = 1) -> Settings:
    """Return a session in which two people with balls press on a box from both sides, lift it, turn, and set it down."""
    hands = [LIFT.format(0.06, 0.07, "rz_rad"), LIFT.format(-0.06, -0.07, "rx_rad")]
    users = [
        {"name": name, "side": side, "tool": "ball", "device": "sim:phantom6", "hand": hand}
        for name, side, hand in zip(("anna", "ben"), ("left", "right"), hands, strict=True)
    ]
    thing = {"kind": "scene", "axes": 6, "file": str(shipped_scene("lift.xml"))}
    link = {"profile": network, "loss": 0.05}
    table = {"seconds": 5.2, "seed": seed, "object": thing, "coupling": {"kind": "local"}, "link": link, "users": users}
    return resolve(table)


@pytest.mark.parametrize(("network", "seed"), [("wan", 1), *[long(name, seed) for name in PROFILES for seed in (2, 3)]])
def test_lines_that_take_hold_of_tools_are_passive(network: str, seed: int) -> None:
    settings = lifting(network, seed)
    laboratory = Laboratory(settings)
    world = laboratory.room.world
    assert isinstance(world, LocalSceneWorld)
    rows = by_tick(laboratory, lambda _: (world.kinematic.tolist(), float(world.position[2])))
    account_of(laboratory)
    summary = of_laboratory(laboratory)
    assert {each for kinematic, _ in rows for each in kinematic} == {False, True}
    assert passive(summary).tone == "good"
    assert summary["server"]["energy_limiter"]["limited_frames"] == 0
    assert world.balance_error_j <= 1e-14
    assert all(person.core.account and person.core.account.state == "live" for person in laboratory.people)
    assert max(high_m for _, high_m in rows) > 0.015


@pytest.mark.long
def test_a_session_of_clear_and_engaged_tools_replays_bit_by_bit(tmp_path: Path) -> None:
    run_laboratory(replace(lifting("wan"), seconds=4.0), tmp_path)
    told = set()
    for name in (SERVER_RECORDING, "client-anna.mcap", "client-ben.mcap"):
        recording = open_recording(tmp_path / name)
        assert verify(recording).exact, name
        for message in recording.messages():
            if recording.topics[message.topic].endswith("datagram_in"):
                heard = decode(msgspec.json.decode(message.payload, type=Datagram).data)
                told.add(len(heard.state) if isinstance(heard, Waves) else type(heard))
    assert told >= {12, 15, 18, Geom}, "of clear and engaged tools down, of hand and proxy up"


@pytest.mark.long
def test_hands_of_three_and_of_six_axes_share_a_room() -> None:
    """A device without an orientation has a pad that does not turn; both are rendered at their hands."""
    thing = {"kind": "scene", "axes": 6, "file": str(shipped_scene("wall.xml"))}
    pad = {"name": "ben", "tool": "pad", "orientation": "fixed", "device": "sim:phantom"}
    pad["hand"] = PRESS.partition("&rz")[0] + "&y_m=0.03,0.03,0.03"
    ball = {"name": "anna", "tool": "ball", "device": "sim:phantom6", "hand": PRESS + "&y_m=-0.05,-0.05,-0.05"}
    coupling, link = {"kind": "local"}, {"profile": "wan"}
    laboratory = laboratory_of(seconds=3.5, object=thing, coupling=coupling, link=link, users=[ball, pad])
    account_of(laboratory)
    stiff = [person.core.account.felt_stiffness_npm for person in laboratory.people]
    assert stiff == pytest.approx([1000.0, 1000.0], rel=0.03)
    world = laboratory.room.world
    assert [np.shape(world.force_of(user)) for user in (0, 1)] == [(6,), (6,)]
    assert world.force_of(0)[0] == pytest.approx(laboratory.people[0].core.force_n[0], abs=0.05)
