"""`cogrip worlds check FILE.xml`: what becomes of a scene that somebody else wrote, before anybody holds its tools."""

import statistics
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from cogrip.cli.settings.settings_file import override
from cogrip.cli.terminal.problem import BadInput
from cogrip.cli.terminal.tables import wrapped
from cogrip.protocol.settings.room import resolve, seat_settings
from cogrip.protocol.settings.sections import Settings
from cogrip.protocol.settings.table import SettingsError

SUFFIXES = (".xml", ".mjcf", ".urdf")
FRAMES = 256  # number of frames that are stepped to see what a frame costs
MARKS = {"ok": ("✓", "green"), "note": ("·", "cyan"), "warning": ("!", "yellow"), "refused": ("✗", "red")}
Row = tuple[str, str, str]
"""Level, topic and words of a finding."""


def check_scene(file: Path, overrides: tuple[str, ...]) -> dict[str, Any]:
    """Return one row for each thing that is worth knowing of a scene.

    `usable` is False where the scene is refused, or makes more energy than hands may be given. Raises BadInput.
    """
    rows = list(rows_of(settings_of(file, overrides)))
    told = [{"level": level, "topic": topic, "text": text} for level, topic, text in rows]
    return {"file": str(file), "usable": not any(level == "refused" for level, _, _ in rows), "rows": told}


def show(answer: dict[str, Any], console: Console) -> None:
    """Print the rows of `check_scene`, each a line."""
    for row in answer["rows"]:
        sign, colour = MARKS[row["level"]]
        line = Text(wrapped(f"{sign} {row['topic']}: {row['text']}", console, "  "))
        line.stylize(colour, 0, 1)
        console.print(line, soft_wrap=True)


def settings_of(file: Path, overrides: tuple[str, ...]) -> Settings:
    """Return the settings of a session of two people in a scene. Raises BadInput."""
    if not file.is_file():
        raise BadInput(f"{file}: there is no such file; give MJCF or URDF")
    users = [{"name": f"user{number + 1}", "side": ("left", "right")[number]} for number in range(2)]
    table = {"name": file.stem, "object": {"kind": "scene", "file": str(file.absolute()), "axes": 3}, "users": users}
    with BadInput.of(SettingsError):
        return resolve(table, dict(override(text) for text in overrides))


def rows_of(settings: Settings) -> Iterator[Row]:
    """Yield what is loaded, added, set, changed and not used, what hands feel, what it makes, and what a frame costs."""
    from cogrip.analysis.finding import in_rows
    from cogrip.analysis.scene_advice import scene_findings
    from cogrip.analysis.scene_pushed import pushed
    from cogrip.server.worlds.scene_file import account_of

    frame_s = seat_settings(settings, 0).rates.frame_s
    account = account_of(settings, frame_s)
    if account.refused:
        yield "refused", "loads", account.refused
        return
    yield (
        "ok",
        "loads",
        f"as MuJoCo reads it, stepped {settings.object.substeps} times a frame of {1e3 * frame_s:.4g} ms",
    )
    for text in account.added:
        yield "ok", "added", text
    if not account.added:
        yield "ok", "added", "nothing: each tool is a body of the scene"
    found = [*scene_findings(settings), pushed(settings)]
    refused = {finding.text for finding in found if finding.refused}
    for (level, topic, text), whose in in_rows(found, [user.name for user in settings.users]).items():
        named = f"{', '.join(whose)}: {text}" if whose[0] else text
        lines = {f"{name}: {text}" if name else text for name in whose}
        yield "refused" if lines & refused else level, topic, named
    yield "ok", "cost", _cost(settings, frame_s)


def _cost(settings: Settings, frame_s: float) -> str:
    """Return what a frame of the scene computes, as it stands at its start."""
    from cogrip.server.worlds.scene import SceneWorld
    from cogrip.server.worlds.scene_file import scene_of_settings

    seats = [seat_settings(settings, seat) for seat in range(len(settings.users))]
    world = SceneWorld(seats, scene_of_settings(settings, frame_s), settings.object.substeps)
    nothing = np.zeros((len(seats), world.axes))
    for user in range(len(seats)):
        world.join(user, np.zeros(world.axes))
    taken: list[int] = []
    for _ in range(FRAMES):
        began = time.thread_time_ns()
        world.step(nothing)
        taken.append(time.thread_time_ns() - began)
    cost_s = 1e-9 * statistics.median(taken)
    return f"a frame takes {1e3 * cost_s:.2g} ms of a processor, {cost_s / frame_s:.0%} of it, on this machine"
