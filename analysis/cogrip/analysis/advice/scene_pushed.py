"""Advice on the energy that a scene makes: its tools are pushed at random, and what nobody put in is counted."""

import numpy as np

from cogrip.analysis.advice.finding import Finding, plain
from cogrip.analysis.advice.scene_overlaps import overlaps
from cogrip.protocol.settings.room import seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.server.worlds.scenes.scene import SceneWorld
from cogrip.server.worlds.scenes.scene_file import Scene, scene_of_settings
from cogrip.server.worlds.scenes.scene_pushes import MOST_MADE_J, PUSHES, push
from cogrip.server.worlds.world import WorldError

SEED = 1
FEW = 20  # number of pushes of a scene that is about to be run
_WORK = 3000  # degrees of freedom times pushes, at most: a larger scene is pushed less often, down to LEAST
LEAST = 10


def pushed(settings: Settings, pushes: int = PUSHES) -> Finding:
    """Return what a scene made in random pushes; refused where that is more than MOST_MADE_J. Raises SceneError."""
    seats = [seat_settings(settings, seat) for seat in range(len(settings.users))]
    scene = scene_of_settings(settings, seats[0].rates.frame_s)
    pushes = max(LEAST, min(pushes, _WORK // max(1, scene.model.nv)))
    active = scene.model.nu or np.any(scene.model.opt.wind)
    try:
        found = push(SceneWorld(seats, scene, settings.object.substeps), SEED, pushes)
    except WorldError as error:
        return Finding("energy", f"in {pushes} random pushes {error}; {_cure(scene)}", "warning", refused=not active)
    text = f"in {pushes} random pushes the scene made {plain(1e3 * found.made_j, 2)} mJ of energy that nobody put in"
    if found.made_j <= MOST_MADE_J:
        return Finding("energy", text)
    if active:
        return Finding(
            "energy",
            f"{text}: its actuators, or its wind, do work, of which hands get no more than they put in",
            "note",
        )
    return Finding("energy", f"{text}, more than {1e3 * MOST_MADE_J:g} mJ; {_cure(scene)}", "warning", refused=True)


def sets_contact(settings: Settings) -> bool:
    """Return whether a scene sets contact of its own, so that it may make energy. Raises SceneError."""
    return bool(scene_of_settings(settings, seat_settings(settings, 0).rates.frame_s).own)


def _cure(scene: Scene) -> str:
    """Return what to change in a scene that makes energy."""
    if scene.own:
        return f"leave {', '.join(scene.own)} out of the scene"
    if inside := overlaps(scene):
        return inside[0].text
    return "raise object.substeps, or give its joints damping"
