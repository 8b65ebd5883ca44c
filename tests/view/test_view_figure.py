"""The pictures of the view in the documentation: committed ones have their size, and the script draws the same moment twice."""

import runpy
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.docs.pages import DOCS, page
from tests.extent import long

SCRIPT = runpy.run_path(str(DOCS / "figures" / "view.py"))
PICTURES = DOCS / "pictures"
MOST_BYTES = 2_000_000


def test_committed_pictures_have_the_size_of_the_script() -> None:
    with Image.open(PICTURES / SCRIPT["STILL"]) as still:
        assert still.size == (SCRIPT["WIDTH"], SCRIPT["HEIGHT"])
    with Image.open(PICTURES / SCRIPT["ANIMATION"]) as animation:
        assert animation.size == SCRIPT["ANIMATION_SIZE"]
        assert animation.n_frames == SCRIPT["SECONDS"] * SCRIPT["FRAMES_HZ"]  # type: ignore[attr-defined]
    assert (PICTURES / SCRIPT["ANIMATION"]).stat().st_size < MOST_BYTES


def test_readme_shows_them() -> None:
    for name in (SCRIPT["STILL"], SCRIPT["ANIMATION"]):
        assert f"](docs/pictures/{name})" in page("README.md")


@pytest.mark.long
@pytest.mark.parametrize(
    ("seconds", "shown_s", "other_s"),
    [(3.5, 3.1, 1.0), long(SCRIPT["BEGIN_S"] + SCRIPT["SECONDS"] + 1.0, SCRIPT["STILL_S"], SCRIPT["BEGIN_S"])],
)
def test_script_shows_the_moments_that_it_is_asked_for(
    chromium: Any, tmp_path: Path, seconds: float, shown_s: float, other_s: float
) -> None:
    """The same moment gives the same scene, another moment another one.

    Plots are left out: they thin their past by how it was reached.
    """
    pngs = SCRIPT["photograph"](chromium, SCRIPT["write_page"](tmp_path, seconds), [shown_s, other_s, shown_s])
    first, other, again = [np.asarray(Image.open(BytesIO(png)).convert("RGB"), dtype=float) for png in pngs]
    stage = slice(None), slice(SCRIPT["WIDTH"] // 2)
    apart = [float(np.mean(np.abs(each - first)[stage] > 20)) for each in (other, again)]
    assert apart[0] > 0.01
    assert apart[1] < 0.001
