"""MuJoCo's own pictures of scenes, off screen, in a process of its own: its kind of OpenGL is chosen when it is imported.

Run as a program: JSON of scenes with their cameras on standard input, a NumPy file of pictures at the path that it is given.
"""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

KINDS = ("egl", "osmesa")  # The kinds of OpenGL that need no window.
LIMIT_S = 300.0


class NoRendererError(Exception):
    """MuJoCo cannot draw here. The text says why."""


@dataclass(frozen=True)
class View:
    """A scene as MJCF, and from where it is seen: places in its world [m], the whole vertical angle, pixels."""

    xml: str
    eye_m: Sequence[float]
    target_m: Sequence[float]
    fov_deg: float
    width: int
    height: int


def pictures_of(views: Sequence[View], folder: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return of each view the colours (rows, columns, 3; 0 to 1) and which pixels are drawn on. Raises NoRendererError."""
    told, said = json.dumps([asdict(each) for each in views]), ""
    for kind in KINDS:
        path = folder / f"{kind}.npz"
        done = subprocess.run(
            [sys.executable, __file__, str(path)], input=told, capture_output=True, text=True, timeout=LIMIT_S,
            env={**os.environ, "MUJOCO_GL": kind}, check=False,
        )  # fmt: skip
        if done.returncode == 0:
            with np.load(path) as found:
                return [(found[f"colours{at}"], found[f"drawn{at}"]) for at in range(len(views))]
        said = (done.stderr.strip().splitlines() or ["it ended without a word"])[-1]
    raise NoRendererError(f"MuJoCo draws nothing off screen here: {said}")


def _main(path: str) -> None:
    import mujoco  # type: ignore[import-untyped]

    found: dict[str, np.ndarray] = {}
    for at, row in enumerate(json.load(sys.stdin)):
        view = View(**row)
        model = mujoco.MjModel.from_xml_string(view.xml)
        data = mujoco.MjData(model)
        model.vis.global_.fovy = view.fov_deg
        model.vis.global_.offwidth, model.vis.global_.offheight = view.width, view.height
        mujoco.mj_forward(model, data)
        model.vis.map.znear = 0.005
        along = np.array(view.target_m) - np.array(view.eye_m)
        camera = mujoco.MjvCamera()
        camera.lookat[:], camera.distance = view.target_m, float(np.linalg.norm(along))
        camera.azimuth = float(np.degrees(np.arctan2(along[1], along[0])))
        camera.elevation = float(np.degrees(np.arcsin(along[2] / camera.distance)))
        with mujoco.Renderer(model, view.height, view.width) as renderer:
            renderer.update_scene(data, camera)
            for flag in ("SHADOW", "REFLECTION", "SKYBOX", "HAZE", "FOG"):
                renderer.scene.flags[getattr(mujoco.mjtRndFlag, f"mjRND_{flag}")] = 0
            found[f"colours{at}"] = renderer.render() / 255.0
            renderer.enable_segmentation_rendering()
            found[f"drawn{at}"] = renderer.render()[..., 0] >= 0
    np.savez_compressed(path, **found)  # type: ignore[arg-type]


if __name__ == "__main__":
    _main(sys.argv[1])
