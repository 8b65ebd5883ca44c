"""Photograph the view: docs/pictures/view.png, and docs/pictures/view.webp, which moves. Needs Chromium.

usage: python docs/figures/view.py [FOLDER]

The session is run in virtual time and shown from its recording, at exact times: the same frames wherever this runs.
"""

import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

from cogrip.protocol.settings.room import resolve
from cogrip.protocol.settings.sections import Settings
from cogrip.results.writing.laboratory_run import run_laboratory
from cogrip.view.page import self_contained
from cogrip.view.recording import open_view
from cogrip.view.scene import to_json

FOLDER = Path(__file__).resolve().parents[1] / "pictures"
STILL, ANIMATION = "view.png", "view.webp"
WIDTH, HEIGHT = 1280, 720
ANIMATION_SIZE, ANIMATION_QUALITY = (960, 540), 70
STROKE_S, REST_S = 1.05, 0.2
PERIOD_S = 2 * (STROKE_S + REST_S)  # of both hands: the animation ends as it begins
STILL_S = 13.1
BEGIN_S, SECONDS, FRAMES_HZ = 11.0, 2 * PERIOD_S, 16
ZOOM_PIXELS = -420  # of the wheel: nearer
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ["--enable-unsafe-swiftshader", "--no-sandbox", "--disable-gpu-sandbox"]
SHOW = """(time_s) => {
  cogrip.seek(time_s);
  return new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
}"""


def settings(seconds: float) -> Settings:
    """Return a session like that of `cogrip demo`, on three axes and over a worse network."""
    reach = f"reach&stroke_s={STROKE_S}&rest_s={REST_S}"
    return resolve(
        {
            "name": "demo",
            "seed": 1,
            "seconds": seconds,
            "coupling": {"impedance_nspm": 20.0, "stiffness_npm": 400.0},
            "object": {"kind": "cube", "mass_kg": 0.2, "axes": 3},
            "link": {"delay_ms": 40.0, "jitter_ms": 5.0, "loss": 0.03},
            "playout": {"frames": 2},
            "users": [
                {"name": "anna", "hand": f"{reach}&amplitude_m=0.06&direction=1,0.5,0.6"},
                {"name": "ben", "hand": f"{reach}&amplitude_m=0.05&direction=1,-0.5,0.2&delay_s=0.3"},
            ],
        }
    )


def write_page(folder: Path, seconds: float = BEGIN_S + SECONDS + 1.0) -> Path:
    """Run the session and write its recording as one page into `folder`; return its path."""
    run = folder / "run"
    run.mkdir()
    run_laboratory(settings(seconds), run)
    recorded = open_view(run)
    page = folder / "page.html"
    chunks = [recorded.chunk(number) for number in range(recorded.scene.chunks)]
    page.write_text(self_contained(to_json(recorded.scene), chunks), encoding="utf-8")
    return page


def photograph(browser: Any, page: Path, times_s: Sequence[float]) -> Iterator[bytes]:
    """Yield a picture of the page, as PNG, for each moment of its recording."""
    tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
    tab.goto(page.as_uri())
    tab.keyboard.press("4")  # iso
    tab.mouse.move(400, 360)
    tab.mouse.wheel(0, ZOOM_PIXELS)
    for time_s in times_s:
        tab.evaluate(SHOW, time_s)
        yield tab.screenshot()
    tab.close()


def write(browser: Any, folder: Path) -> list[Path]:
    """Write both pictures; return their paths."""
    paths = [folder / STILL, folder / ANIMATION]
    times_s = [BEGIN_S + number / FRAMES_HZ for number in range(round(SECONDS * FRAMES_HZ))]
    with TemporaryDirectory() as scratch:
        page = write_page(Path(scratch))
        paths[0].write_bytes(next(photograph(browser, page, [STILL_S])))
        pictures = [Image.open(BytesIO(png)).convert("RGB") for png in photograph(browser, page, times_s)]
    first, *rest = [picture.resize(ANIMATION_SIZE, Image.Resampling.LANCZOS) for picture in pictures]
    first.save(
        paths[1], save_all=True, append_images=rest, duration=round(1000 / FRAMES_HZ), loop=0,
        quality=ANIMATION_QUALITY, method=4,
    )  # fmt: skip
    return paths


@contextmanager
def started_browser() -> Iterator[Any]:
    """Start a browser without a window. Exits with the cure where there is none."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    if program is None:
        raise SystemExit(f"no browser: install one of {', '.join(PROGRAMS)}")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, headless=True, args=FLAGS)
        yield browser
        browser.close()


def main(folder: Path) -> None:
    """Write the pictures."""
    with started_browser() as browser:
        for written in write(browser, folder):
            print(f"{written}: {written.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
