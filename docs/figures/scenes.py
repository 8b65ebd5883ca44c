"""Photograph the scenes that come with cogrip, at work: docs/pictures/scenes.webp. Needs Chromium.

usage: python docs/figures/scenes.py [FOLDER]
"""

import sys
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image
from view import FOLDER, SHOW, started_browser

from cogrip.cli.settings.settings_file import load
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.view.page import self_contained
from cogrip.view.recording import open_view
from cogrip.view.scene import to_json

MOMENTS_S = {"wall": 2.5, "lift": 4.5, "pile": 7.0, "peg": 7.0, "table": 5.5, "valve": 4.0, "wheel": 4.0}
"""Settings, and the moment of their session that is shown."""
SIZE, TILE, COLUMNS = (1280, 720), (532, 385), 3  # of a page; of the part of it with the scene; side by side
STAGE = (30, 100, 790, 650)


def photograph(browser: Any, name: str, folder: Path) -> Image.Image:
    """Return the picture of a session's scene at its moment."""
    run = folder / name
    run.mkdir()
    run_laboratory(load(Path(name), [f"seconds={MOMENTS_S[name] + 0.5}"]), run)
    recorded = open_view(run)
    page = folder / f"{name}.html"
    chunks = [recorded.chunk(number) for number in range(recorded.scene.chunks)]
    page.write_text(self_contained(to_json(recorded.scene), chunks), encoding="utf-8")
    tab = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]}, color_scheme="light")
    tab.goto(page.as_uri())
    tab.keyboard.press("4")  # iso
    tab.get_by_role("button", name="ghost").first.click()  # without what a person is shown
    tab.evaluate(SHOW, MOMENTS_S[name])
    picture = Image.open(BytesIO(tab.screenshot())).convert("RGB")
    tab.close()
    return picture


def pictures(browser: Any) -> Iterator[Image.Image]:
    """Yield a picture of each scene."""
    with TemporaryDirectory() as scratch:
        for name in MOMENTS_S:
            yield photograph(browser, name, Path(scratch))


def main(folder: Path) -> None:
    """Write the picture of all."""
    with started_browser() as browser:
        tiles = [picture.crop(STAGE).resize(TILE, Image.Resampling.LANCZOS) for picture in pictures(browser)]
    rows = -(-len(tiles) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * TILE[0], rows * TILE[1]), "white")
    for number, tile in enumerate(tiles):
        sheet.paste(tile, (number % COLUMNS * TILE[0], number // COLUMNS * TILE[1]))
    written = folder / "scenes.webp"
    sheet.save(written, quality=80, method=6)
    print(f"{written}: {written.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
