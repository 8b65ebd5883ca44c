"""A motor that swings, and a mocap body on a recorded way."""

from math import sin
from pathlib import Path

import numpy as np

from cogrip.server.worlds.scenes.scene_script import SceneScript


class OnItsWay(SceneScript):
    """t_s, x_m, y_m, z_m of motion.csv are the place of the body "cart"."""

    kept = ("frames",)

    def __init__(self):
        self.frames = 0
        self.way = np.loadtxt(Path(__file__).with_name("motion.csv"), delimiter=",", skiprows=1)

    def frame(self, scene):
        self.frames += 1
        now = [np.interp(scene.time_s, self.way[:, 0], self.way[:, each]) for each in (1, 2, 3)]
        scene.put("cart", now)
        scene.set_control("servo", 0.5 * sin(4.0 * scene.time_s))
