"""`dev.py bench drawing`: the page's pictures of twenty scenes beside MuJoCo's own, pixel by pixel, from the same place."""

import tempfile
from pathlib import Path

import matplotlib.image
from rich.console import Console

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import Problem
from cogrip.cli.terminal.tables import plain_table

from tests.view.browser_program import NoBrowserError, launched
from tests.view.compared_pictures import compare, sheet
from tests.view.mujoco_pictures import NoRendererError

LEAST_ALIKE = 0.98


def bench_drawing(*, out: Path | None = None, width: int = 1280, height: int = 720) -> int:
    """Draw twenty scenes on the page and with MuJoCo; report how many pixels agree, and how far colours are apart.

    Parameters
    ----------
    out
        A PNG file of all pairs, the page's on the left of each.
    width
        Of the page [pixels].
    height
        Likewise.
    """
    console: Console = make_console()
    try:
        with tempfile.TemporaryDirectory() as folder, launched() as browser:
            compared = compare(browser, Path(folder), width=width, height=height)
    except (NoBrowserError, NoRendererError) as error:
        raise Problem(str(error)) from None
    rows = [
        (each.name, f"{100 * each.alike:.2f} %", f"{100 * each.overlap:.2f} %", f"{each.colour:.3f}")
        for each in compared
    ]
    console.print(plain_table(("scene", "pixels alike", "overlap of the drawn", "colour apart"), rows))
    if out is not None:
        matplotlib.image.imsave(out, sheet(compared))
    worst = min(compared, key=lambda each: each.alike)
    reached = worst.alike >= LEAST_ALIKE
    console.print(f"least: {100 * worst.alike:.2f} % ({worst.name}), asked for {100 * LEAST_ALIKE:.0f} %")
    return 0 if reached else 1
