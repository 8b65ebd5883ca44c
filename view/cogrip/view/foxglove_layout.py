"""A layout of panels for Foxglove and Lichtblick: the scene, force, delay and energy reserve of each person, and states.

It has the paths of a recording and those of the live socket: whichever is open fills the panels. The form is the file that both
export and import: a configuration for each panel by `TYPE!NUMBER`, and a tree of panels.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cogrip.protocol.axes import PLACES
from cogrip.protocol.session_drawing import colour
from cogrip.results.reading.export import Exported, ExportError
from cogrip.results.reading.records import RunRecords

NAME = "layout.json"
_AXES = ("x", "y", "z")
_CAMERA = {
    "distance": 0.5, "perspective": True, "phi": 60.0, "thetaOffset": 30.0, "target": [0.0, 0.0, 0.0],
    "targetOffset": [0, 0, 0],
    "targetOrientation": [0, 0, 0, 1], "fovy": 45.0, "near": 0.005, "far": 100.0,
}  # fmt: skip


def export_layout(run: RunRecords, out: Path) -> list[Exported]:
    """Write the layout of a run into the folder `out`. Raises ExportError where something is in the way, and OSError."""
    path, settings = out / NAME, run.settings()
    if path.exists():
        raise ExportError(f"{path} exists, and nothing is overwritten; remove it, or name another folder")
    if settings is None:
        raise ExportError(f"{run.folder} has no recording of the server, which tells room and people")
    text = layout(settings.name, run.names(), min(settings.object.axes, PLACES))
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return [Exported(path, text.count("\n"))]


def layout(room: str, people: Sequence[str], axes: int = 3) -> str:
    """Return the layout of a room and its people as JSON text. axes: those of which forces are drawn."""
    force, delay, reserve, states = [], [], [], []
    for seat, name in enumerate(people):
        shade = colour(seat)
        for place, axis in enumerate(_AXES[:axes]):
            force.append(_series(f"/{name}/tick.force_n[{place}]", f"{name} {axis} [N]", shade))
            force.append(_series(f"/{name}/state.force_n.{axis}", f"{name} {axis} [N], live", shade))
        delay += [_series(f"/{name}/tick.{key}", f"{name} {key}", shade) for key in ("rtt_ms", "up_ms", "down_ms")]
        delay.append(_series(f"/{name}/state.rtt_ms", f"{name} rtt_ms, live", shade))
        reserve.append(_series(f"/{name}/tick.device_reserve_j", f"{name} device [J]", shade))
        reserve.append(_series(f"/{name}/tick.reserve_j", f"{name} line down [J]", shade))
        states += [_series(f"/{name}/tick.state", name), _series(f"/{name}/state.state", f"{name}, live")]
    panels: dict[str, dict[str, Any]] = {
        "3D!scene": {
            "cameraState": _CAMERA, "followMode": "follow-pose", "followTf": room, "scene": {}, "transforms": {},
            "topics": {f"{place}/{kind}": {"visible": True} for place in ("", f"/room/{room}") for kind in ("scene", "forces")},
            "layers": {}, "publish": {},
        },
        "Plot!force": _plot("Force on the hand", force), "Plot!delay": _plot("Delay [ms]", delay),
        "Plot!reserve": _plot("Energy reserve", reserve),
        "StateTransitions!states": {"paths": states, "isSynced": True, "foxglovePanelTitle": "State of the safety"},
        "RawMessages!events": {"topicPath": "/server/event", "foxglovePanelTitle": "Events"},
    }  # fmt: skip
    plots = _split("column", _split("column", "Plot!force", "Plot!delay", 50), "Plot!reserve", 66)
    left = _split("column", "3D!scene", _split("row", "StateTransitions!states", "RawMessages!events", 60), 70)
    whole = {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1},
        "layout": _split("row", left, plots, 50),
    }  # fmt: skip
    return json.dumps(whole, indent=2) + "\n"


def _series(path: str, label: str, shade: str = "") -> dict[str, Any]:
    found = {"value": path, "label": label, "enabled": True, "timestampMethod": "receiveTime"}
    return {**found, "color": shade} if shade else found


def _plot(title: str, paths: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {
        "paths": paths, "xAxisVal": "timestamp", "isSynced": True, "showLegend": True, "legendDisplay": "floating",
        "showPlotValuesInLegend": False, "showXAxisLabels": True, "showYAxisLabels": True, "sidebarDimension": 240,
        "foxglovePanelTitle": title,
    }  # fmt: skip


def _split(direction: str, first: Any, second: Any, percent: int) -> dict[str, Any]:
    return {"direction": direction, "first": first, "second": second, "splitPercentage": percent}
