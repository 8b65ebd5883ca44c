"""The page's pictures of scenes beside MuJoCo's own, pixel by pixel, from the same place."""

from base64 import b64decode
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.image
import mujoco  # type: ignore[import-untyped]
import numpy as np

from cogrip.server.worlds.scenes.scene_file import Held, load_scene
from cogrip.server.worlds.scenes.scene_shapes import Drawn, shapes_of
from cogrip.view.frames import SceneFrame, encode
from cogrip.view.scene import DrawnObject, PageScene, to_json, workspace_of

from tests.view.browser_page import BrowserPage
from tests.view.drawn_scenes import SCENES
from tests.view.mujoco_pictures import View, pictures_of
from tests.view.page_server import PageServer, serving

STEP_S = 1 / 512
BACKGROUNDS = ("#ff00ff", "#00ff00")  # a pixel that has the colour of each in its turn has nothing drawn on it
PROBE = View(
    "<mujoco/>", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 35.0, 64, 64
)  # draws nothing: it says whether there is a renderer


@dataclass(frozen=True)
class Compared:
    """One scene in both pictures.

    alike      share of pixels on which both draw, or neither does
    overlap    pixels on which both draw, over those on which either does
    colour     mean difference of the colours there, 0 to 1, after the page's picture was made as bright as MuJoCo's
    ours, theirs  pictures, rows, columns, red green blue
    """

    name: str
    alike: float
    overlap: float
    colour: float
    ours: np.ndarray
    theirs: np.ndarray


def drawn_of(path: Path) -> tuple[PageScene, SceneFrame, Drawn]:
    """Return a scene file as a page is told of it: bodies where they start, in the file's own frame."""
    scene = load_scene(path, [Held("ball", "left", "")], STEP_S)
    drawn, data = shapes_of(scene, np.zeros(3)), scene.start.data(scene.model)
    mujoco.mj_forward(scene.model, data)
    points = drawn.points.places(data)
    places = np.concatenate((data.xpos[drawn.bodies], points))
    turns = np.concatenate((data.xquat[drawn.bodies], np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))))
    poses = tuple([tuple(row) for row in np.concatenate((places, turns), axis=1).tolist()])
    seen = [each for each in drawn.shapes if each.seat is None]
    told = PageScene(
        path.stem, "live", 3, 128, 1024, DrawnObject("scene", "box", (0.04,) * 3, 0.5), geoms=drawn.shapes,
        workspace_m=workspace_of(seen, poses),
    )  # fmt: skip
    frame = SceneFrame(3, 1, 1 / 64, (0.0,) * 3, (0.0,) * 3, (), (1.0, 0.0, 0.0, 0.0), 0, poses)
    return told, frame, drawn


def portrait(page: BrowserPage, background: str) -> tuple[np.ndarray, dict[str, Any]]:
    """Return the picture of a page's bodies alone, and its camera."""
    found = page.state(f"cogrip.portrait('{background}')")
    pixels = matplotlib.image.imread(BytesIO(b64decode(found["png"].partition(",")[2])), format="png")
    return pixels[..., :3], found


def compare(
    browser: Any, folder: Path, scenes: dict[str, str] = SCENES, width: int = 1280, height: int = 720
) -> list[Compared]:
    """Draw scenes on the page and with MuJoCo. Raises NoRendererError."""
    pictures_of([PROBE], folder)
    ours: list[tuple[np.ndarray, np.ndarray]] = []
    views: list[View] = []
    for name, xml in scenes.items():
        path = folder / f"{name.replace(' ', '_')}.xml"
        path.write_text(xml)
        told, frame, _ = drawn_of(path)
        with serving(PageServer(to_json(told))) as server:
            page = BrowserPage(browser, server.address, width, height)
            server.wait_for_page()
            page.until("cogrip.scene !== null")
            server.send(encode(frame))
            page.until_drawn(1)
            first, camera = portrait(page, BACKGROUNDS[0])
            second, _ = portrait(page, BACKGROUNDS[1])
            black, _ = portrait(page, "#000000")
            page.close()
            assert page.errors == []
        bare = [_is(picture, colour) for picture, colour in zip((first, second), BACKGROUNDS, strict=True)]
        ours.append((black, ~(bare[0] & bare[1])))
        rows, columns = black.shape[:2]
        views.append(View(xml, camera["eye_m"], camera["target_m"], camera["fov_deg"], columns, rows))
    theirs = pictures_of(views, folder)
    return [_compared(name, *mine, *yours) for name, mine, yours in zip(scenes, ours, theirs, strict=True)]


def _compared(
    name: str, ours: np.ndarray, our_mask: np.ndarray, theirs: np.ndarray, their_mask: np.ndarray
) -> Compared:
    both, either = our_mask & their_mask, our_mask | their_mask
    mine, yours = ours[both], theirs[both]
    brighter = yours.sum() / max(1e-9, mine.sum())
    colour = float(np.abs(brighter * mine - yours).mean()) if both.any() else 1.0
    alike, overlap = float((our_mask == their_mask).mean()), float(both.sum() / max(1, either.sum()))
    return Compared(name, alike, overlap, colour, ours, theirs)


def _is(picture: np.ndarray, colour: str) -> np.ndarray:
    wanted = np.array([int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)])
    near: np.ndarray = (np.abs(picture - wanted) < 1 / 510).all(axis=2)
    return near


def sheet(compared: Sequence[Compared], columns: int = 4) -> np.ndarray:
    """Return all pairs as one picture: the page's on the left of each pair."""
    pairs = [np.concatenate((each.ours, each.theirs), axis=1)[::2, ::2] for each in compared]
    pairs += [np.zeros_like(pairs[0])] * (-len(pairs) % columns)
    rows = [np.concatenate(pairs[at : at + columns], axis=1) for at in range(0, len(pairs), columns)]
    return np.concatenate(rows)
