"""Coupling schemes at the server: which message carries a frame, which port takes it in, which world it moves.

A new scheme is a row of `SCHEMES` here, one at the client and more: docs/design.md, "Add a coupling scheme". Worlds for waves
are in `cogrip.server.worlds.registry`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from cogrip.protocol.settings.object_kinds import KINDS
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.types import Kind
from cogrip.protocol.wire.messages import Frame, Power, State, Waves
from cogrip.server.ports.local_port import LocalPort
from cogrip.server.ports.port import Port
from cogrip.server.ports.power_port import PowerPort
from cogrip.server.ports.seat_limits import SeatLimits
from cogrip.server.ports.state_port import StatePort
from cogrip.server.ports.wave_port import WavePort
from cogrip.server.worlds.lagged import CoupledWorld, PaperWorld
from cogrip.server.worlds.local_faces import LocalFacesWorld
from cogrip.server.worlds.power import PowerWorld
from cogrip.server.worlds.registry import make_guarded, world_class_of
from cogrip.server.worlds.scene_text import SceneError
from cogrip.server.worlds.small_room import MOST, SmallGripWorld
from cogrip.server.worlds.world import World

MakeWorld = Callable[[Sequence[SeatSettings]], World]


def make_wave_world(seats: Sequence[SeatSettings]) -> World:
    """Return the passive world of an object, unless the settings ask for the paper's own step.

    A cube of few axes is stepped by `SmallGripWorld`, the same world in plain floats.
    """
    first = seats[0]
    if first.coupling.server_step == "paper":
        return PaperWorld(seats)
    if first.object.kind == "cube" and len(seats) * first.object.axes <= MOST:
        return SmallGripWorld(seats)
    return world_class_of(first.object.kind).make(seats)


class Scheme(NamedTuple):
    """One coupling scheme."""

    frame: type[Frame]
    make_port: Callable[[SeatSettings, SeatLimits, float], Port]
    make_world: MakeWorld


SCHEMES: dict[Kind, Scheme] = {
    "wave": Scheme(Waves, WavePort, make_wave_world),
    "local": Scheme(Waves, LocalPort, LocalFacesWorld),
    "coupling": Scheme(State, StatePort, CoupledWorld),
    "tdpa": Scheme(Power, PowerPort, PowerWorld),
}
"""Scheme by `coupling.kind` of the settings, the same for all seats of a room."""

FRAMES = tuple(scheme.frame for scheme in SCHEMES.values())


def make_world(seats: Sequence[SeatSettings]) -> World:
    """Return the world for these seats, all of one room without a scene."""
    return SCHEMES[seats[0].coupling.kind].make_world(seats)


def make_scene_world(settings: Settings, seats: Sequence[SeatSettings]) -> World:
    """Return the world of a scene, run by its script where there is one.

    Raises SceneError for a file that cannot be used, and where there is no MuJoCo; WorldKindError, WorldError for a script.
    """
    try:  # MuJoCo is loaded where there is a scene
        from cogrip.server.worlds import driven_scene, local_scene, scene, scene_file, scene_script
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise SceneError(
            "a scene needs the package mujoco-core, which is not installed; pip install mujoco-core, on a system "
            "that it has a wheel for (docs/platforms.md), or take another object.kind"
        ) from None

    given = settings.object
    worlds: dict[Kind, type[scene.SceneWorld]] = {
        "wave": scene.SceneWorld, "local": local_scene.LocalScene, "coupling": driven_scene.CoupledScene,
        "tdpa": driven_scene.PowerScene,
    }  # fmt: skip
    make = worlds[settings.coupling.kind]
    script, identity = scene_script.script_of(given.script) if given.script else (None, "")
    loaded = scene_file.scene_of_settings(settings, seats[0].rates.frame_s, identity)
    world = make(seats, loaded, given.substeps)
    world.watch(settings.task)
    if script is not None:
        world.follow(script)
    return world


def make_room_world(settings: Settings, seats: Sequence[SeatSettings]) -> World:
    """Return the world of a room. Raises SceneError for a scene that cannot be used; WorldKindError, WorldError for a world."""
    kind = settings.object.kind
    if kind == "scene":
        return make_scene_world(settings, seats)
    return make_world(seats) if kind in KINDS else make_guarded(kind, seats)
