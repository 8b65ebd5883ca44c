"""`cogrip worlds check FILE.xml`: what becomes of a scene that somebody else wrote, before anybody holds its tools."""

import shlex
import statistics
import time
from collections.abc import Callable, Iterator
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
MOST_HOLD_S = 60.0  # most processor time for the delays up to which something stays held
FRAMES = 256  # number of frames that are stepped to see what a frame costs
MARKS = {"ok": ("✓", "green"), "note": ("·", "cyan"), "warning": ("!", "yellow"), "refused": ("✗", "red")}
TableRow = tuple[str, str, str]
"""Level, topic and words of a finding."""


def check_scene(
    file: Path, overrides: tuple[str, ...], tell: Callable[[TableRow], None] = lambda row: None
) -> dict[str, Any]:
    """Return one row for each thing that is worth knowing of a scene. tell: called with each as soon as it is known.

    `usable` is False where the scene is refused, or makes more energy than hands may be given. Raises BadInput.
    """
    settings = settings_of(file, overrides)
    rows = []
    for row in rows_of(settings):
        rows.append(row)
        tell(row)
    usable = not any(level == "refused" for level, _, _ in rows)
    answer: dict[str, Any] = {"file": str(file), "usable": usable}
    if usable:
        row, answer["held"] = _held(settings)
        rows.append(row)
        tell(row)
    return answer | {"rows": [{"level": level, "topic": topic, "text": text} for level, topic, text in rows]}


def shown_on(console: Console) -> Callable[[TableRow], None]:
    """Return a function that prints a row of `check_scene`, on a line of its own."""

    def show(row: TableRow) -> None:
        level, topic, text = row
        sign, colour = MARKS[level]
        line = Text(wrapped(f"{sign} {topic}: {text}", console, "  "))
        line.stylize(colour, 0, 1)
        console.print(line, soft_wrap=True)

    return show


def settings_of(file: Path, overrides: tuple[str, ...]) -> Settings:
    """Return the settings of a session of two people in a scene. Raises BadInput."""
    if not file.is_file():
        raise BadInput(f"{file}: there is no such file; give MJCF or URDF")
    users = [{"name": f"user{number + 1}", "side": ("left", "right")[number]} for number in range(2)]
    table = {"name": file.stem, "object": {"kind": "scene", "file": str(file.absolute()), "axes": 3}, "users": users}
    with BadInput.of(SettingsError):
        return resolve(table, dict(override(text) for text in overrides))


def rows_of(settings: Settings) -> Iterator[TableRow]:
    """Yield what is loaded, added, set, changed and not used, what hands feel, what it makes, and what a frame costs."""
    from cogrip.analysis.advice.finding import in_rows
    from cogrip.analysis.advice.scene_advice import scene_findings
    from cogrip.analysis.advice.scene_pushed import pushed
    from cogrip.server.worlds.scenes.scene_file import account_of

    frame_s = seat_settings(settings, 0).rates.frame_s
    account = account_of(settings, frame_s)
    if account.refused:
        yield "refused", "loads", account.refused
        if account.folder:
            command = shlex.join(
                ["cogrip", "worlds", "check", settings.object.file, "--set", f"object.folder={account.folder}"]
            )
            yield "note", "to load it", f"`{command}`, if all that lies below that folder may be read"
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


def _held(settings: Settings) -> tuple[TableRow, dict[str, Any]]:
    """Return up to which delay the scene's object stays held, as a row and in numbers."""
    from cogrip.analysis.advice.scene_hold import MOST_SLIP_M, SECONDS, hold

    began_s = time.process_time()
    found = hold(settings, lambda: time.process_time() - began_s > MOST_HOLD_S)
    spent_s = time.process_time() - began_s
    finding = found.finding()
    text = (
        f"{finding.text}; computed in {spent_s:.1f} s of {MOST_HOLD_S:g} that this may take"
        if found.tried
        else finding.text
    )
    tried = [
        {
            "delay_ms": each.delay_ms,
            "held": each.held,
            "lifted_m": each.lifted_m,
            "slip_m": each.slip_m,
            "why": each.why,
        }
        for each in found.tried
    ]
    numbers = {
        "body": found.body, "press_n": found.press_n, "up_to_ms": found.up_to_ms, "most_slip_m": MOST_SLIP_M,
        "session_s": SECONDS, "tried": tried, "why": found.why,
    }  # fmt: skip
    return (finding.level, finding.topic, text), numbers


def _cost(settings: Settings, frame_s: float) -> str:
    """Return what a frame of the scene computes, as it stands at its start."""
    from cogrip.server.worlds.scenes.scene import SceneWorld
    from cogrip.server.worlds.scenes.scene_file import scene_of_settings

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
