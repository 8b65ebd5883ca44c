"""Coupling schemes at the server: which port takes a frame in, and which world it moves.

A new scheme is a row of `SCHEMES` here, one at the client and one with its properties: docs/design.md, "Add a coupling
scheme". Worlds for waves are in `cogrip.server.worlds.registry`.
"""

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.object_kinds import KINDS
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.sections import Settings
from cogrip.server.ports.local_port import LocalPort
from cogrip.server.ports.partner_port import PartnerPort
from cogrip.server.ports.port import Port
from cogrip.server.ports.power_port import PowerPort
from cogrip.server.ports.seat_limits import SeatLimits
from cogrip.server.ports.state_port import StatePort
from cogrip.server.ports.wave_port import WavePort
from cogrip.server.worlds.lagged import CoupledWorld, PaperWorld
from cogrip.server.worlds.local_faces import LocalFacesWorld
from cogrip.server.worlds.partners import PartnersWorld
from cogrip.server.worlds.power import PowerWorld
from cogrip.server.worlds.registry import make_guarded, world_class_of
from cogrip.server.worlds.scenes.scene_text import SceneError
from cogrip.server.worlds.world import World

if TYPE_CHECKING:
    from cogrip.server.worlds.scenes.scene import SceneWorld

MakeWorld = Callable[[Sequence[SeatSettings]], World]


def make_wave_world(seats: Sequence[SeatSettings]) -> World:
    """Return the passive world of an object, unless the settings ask for the paper's own step."""
    first = seats[0]
    if first.coupling.server_step == "paper":
        return PaperWorld(seats)
    return world_class_of(first.object.kind).make(seats)


class Scheme(NamedTuple):
    """One coupling scheme.

    scene: module and class, in `worlds.scenes`, of its world of rigid bodies, for which MuJoCo is loaded; None: no scene
    """

    make_port: Callable[[SeatSettings, SeatLimits, float], Port]
    make_world: MakeWorld
    scene: tuple[str, str] | None


SCHEMES: dict[Kind, Scheme] = {
    "wave": Scheme(WavePort, make_wave_world, ("scene", "SceneWorld")),
    "local": Scheme(LocalPort, LocalFacesWorld, ("local_scene", "LocalSceneWorld")),
    "coupling": Scheme(StatePort, CoupledWorld, ("driven_scene", "CoupledScene")),
    "tdpa": Scheme(PowerPort, PowerWorld, ("driven_scene", "PowerScene")),
    "partner": Scheme(PartnerPort, PartnersWorld, ("partner_scene", "PartnersScene")),
}
"""Scheme by `coupling.kind` of the settings, the same for all seats of a room."""


def make_world(seats: Sequence[SeatSettings]) -> World:
    """Return the world for these seats, all of one room without a scene."""
    return SCHEMES[seats[0].coupling.kind].make_world(seats)


def make_scene_world(settings: Settings, seats: Sequence[SeatSettings]) -> World:
    """Return the world of a scene, run by its script where there is one.

    Raises SceneError for a file that cannot be used, and where there is no MuJoCo; WorldKindError, WorldError for a script.
    """
    scene = SCHEMES[settings.coupling.kind].scene
    if scene is None:
        raise SceneError(f'coupling.kind = "{settings.coupling.kind}" has no scenes; set coupling.kind = "wave"')
    module, name = scene
    try:  # MuJoCo is loaded where there is a scene
        scene_file = import_module("cogrip.server.worlds.scenes.scene_file")
        scene_script = import_module("cogrip.server.worlds.scenes.scene_script")
        make: type[SceneWorld] = getattr(import_module(f"cogrip.server.worlds.scenes.{module}"), name)
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise SceneError(
            "a scene needs the package mujoco-core, which is not installed; pip install mujoco-core, on a system "
            "that it has a wheel for (docs/platforms.md), or take another object.kind"
        ) from None
    given = settings.object
    script, identity = scene_script.script_of(given.script) if given.script else (None, "")
    world = make(seats, scene_file.scene_of_settings(settings, seats[0].rates.frame_s, identity), given.substeps)
    world.progress.watch(settings.task)
    if script is not None:
        world.follow(script)
    return world


def make_room_world(settings: Settings, seats: Sequence[SeatSettings]) -> World:
    """Return the world of a room. Raises SceneError for a scene that cannot be used; WorldKindError, WorldError for a world."""
    kind = settings.object.kind
    if settings.object.traits.scene:
        return make_scene_world(settings, seats)
    return make_world(seats) if kind in KINDS else make_guarded(kind, seats)
