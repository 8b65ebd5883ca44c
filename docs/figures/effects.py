"""Draw haptic effects: docs/pictures/effects.png.

Left: the hand of configs/effects.toml among its fixtures, seen from above. Right: its force and the energy tank over time,
of the same session in virtual time.

usage: python docs/figures/effects.py [FOLDER]
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.patches import Circle, Rectangle

from cogrip.cli.settings.settings_file import load
from cogrip.cli.settings.shipped_settings import shipped
from cogrip.protocol.settings.effects import EFFECT_KINDS, Effect
from cogrip.results.plots.style import INK, Sheet, colour, png, title
from cogrip.sim.laboratory import Laboratory

FOLDER = Path(__file__).parent.parent / "pictures"
KINDS = tuple(EFFECT_KINDS)
VIEW_MM = ((-85.0, 15.0), (-65.0, 65.0))


def run() -> tuple[list[tuple[float, ...]], tuple[Effect, ...]]:
    """Return (time [s], x, y [mm], |F| [N], tank [mJ]) of each tick, and the effects."""
    settings, rows = load(shipped("effects")), []
    tick_s = 1.0 / settings.rates.device_hz

    def watch(now: Laboratory) -> None:
        core = now.people[0].core
        seat = core.seated
        tank_j = seat.effects.tank.level_j if seat and seat.effects.present else float("nan")
        x, y = core.position_m[:2]
        rows.append((now.tick * tick_s, 1e3 * x, 1e3 * y, float(np.linalg.norm(core.force_n)), 1e3 * tank_j))

    Laboratory(settings).run(watch)
    return rows, settings.effects


def main(folder: Path) -> None:
    """Run the session and write the picture."""
    rows, effects = run()
    time_s, x, y, force, tank = np.array(rows).T
    sheet = Sheet(1, 3, row_in=3.4, widths=(1.0, 1.0, 1.0))
    above, forces, energy = sheet.panels[0]
    for effect in effects:
        style = {"color": colour(KINDS.index(effect.kind)), "alpha": 0.3, "lw": 0}
        at = [1e3 * each for each in effect.place_m]
        half = [1e3 * each for each in effect.size_m]
        if effect.kind == "magnet":
            above.add_patch(Circle((at[0], at[1]), 1e3 * effect.radius_m, **style))
        elif effect.points_m:
            above.plot(*(1e3 * np.array(effect.points_m).T[:2]), **{**style, "lw": 5, "alpha": 0.5})
        elif any(half):
            above.add_patch(Rectangle((at[0] - half[0], at[1] - half[1]), 2 * half[0], 2 * half[1], **style))
    above.plot(x, y, color=INK, lw=1.2)
    above.set_xlim(*VIEW_MM[0])
    above.set_ylim(*VIEW_MM[1])
    forces.plot(time_s, force, color=INK, lw=0.7)
    energy.plot(time_s, tank, color=INK, lw=1.2)
    energy.set_ylim(0.0, 10.5)
    title(above, "the hand, y over x [mm]")
    title(forces, "force [N]")
    title(energy, "energy tank [mJ]")
    drawn = {effect.kind for effect in effects} - {"vibration"}
    legend = [(kind, {"facecolor": colour(at), "alpha": 0.5}) for at, kind in enumerate(KINDS) if kind in drawn]
    figure = sheet.finish(["x [mm]", "time [s]", "time [s]"], ["", "", ""], legend)
    (folder / "effects.png").write_bytes(png(figure))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else FOLDER)
