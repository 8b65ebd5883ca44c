"""The page's pictures of twenty scenes beside those of MuJoCo's own renderer."""

from pathlib import Path
from typing import Any

import pytest

from tests.view.compared_pictures import compare
from tests.view.drawn_scenes import SCENES
from tests.view.mujoco_pictures import NoRendererError

LEAST_ALIKE, LEAST_OVERLAP, MOST_APART = 0.98, 0.9, 0.08


@pytest.mark.long
def test_the_page_draws_scenes_as_mujoco_does(chromium: Any, tmp_path: Path) -> None:
    assert len(SCENES) == 20
    try:
        compared = compare(chromium, tmp_path)
    except NoRendererError as error:
        pytest.skip(str(error))
    for each in compared:
        assert each.alike >= LEAST_ALIKE, each.name
        assert each.overlap >= LEAST_OVERLAP, each.name
        assert each.colour <= MOST_APART, each.name
