"""Published schemas of `foxglove.SceneUpdate` and `foxglove.FrameTransforms`: fields that values must have, and a checker."""

from collections.abc import Mapping
from typing import Any

_XYZ = {"x": float, "y": float, "z": float}
_TIME = {"sec": int, "nsec": int}
_POSE = {"position": _XYZ, "orientation": {**_XYZ, "w": float}}
_COLOR = {"r": float, "g": float, "b": float, "a": float}
_SIZED = {"pose": _POSE, "size": _XYZ, "color": _COLOR}
_ARROW = {
    "pose": _POSE, "shaft_length": float, "shaft_diameter": float, "head_length": float, "head_diameter": float,
    "color": _COLOR,
}  # fmt: skip
_LINE = {
    "type": int, "pose": _POSE, "thickness": float, "scale_invariant": bool, "points": [_XYZ], "color": _COLOR,
    "colors": [_COLOR], "indices": [int],
}  # fmt: skip
_TRIANGLES = {"pose": _POSE, "points": [_XYZ], "color": _COLOR, "colors": [_COLOR], "indices": [int]}
_TEXT = {
    "pose": _POSE, "billboard": bool, "font_size": float, "scale_invariant": bool, "color": _COLOR, "text": str,
}  # fmt: skip
_ENTITY = {
    "timestamp": _TIME, "frame_id": str, "id": str, "lifetime": _TIME, "frame_locked": bool,
    "metadata": [{"key": str, "value": str}], "arrows": [_ARROW], "cubes": [_SIZED], "spheres": [_SIZED],
    "cylinders": [{**_SIZED, "bottom_scale": float, "top_scale": float}],
    "lines": [_LINE], "triangles": [_TRIANGLES], "texts": [_TEXT], "models": [{}],
}  # fmt: skip
_TRANSFORM = {
    "timestamp": _TIME, "parent_frame_id": str, "child_frame_id": str, "translation": _XYZ, "rotation": {**_XYZ, "w": float},
}  # fmt: skip
PUBLISHED: dict[str, Any] = {
    "foxglove.SceneUpdate": {"deletions": [{"timestamp": _TIME, "type": int, "id": str}], "entities": [_ENTITY]},
    "foxglove.FrameTransforms": {"transforms": [_TRANSFORM]},
}
"""Every field is required; a list holds the type of its items."""
_JSON_NAMES = {float: "number", int: "integer", str: "string", bool: "boolean"}


def check_value(value: object, wanted: Any, where: str = "") -> None:
    """Assert that a decoded message is what was published."""
    if isinstance(wanted, Mapping):
        assert isinstance(value, dict), where
        assert value.keys() == wanted.keys(), where
        for key, kind in wanted.items():
            check_value(value[key], kind, f"{where}.{key}")
    elif isinstance(wanted, list):
        assert isinstance(value, list), where
        for item in value:
            check_value(item, wanted[0], f"{where}[]")
    else:
        kinds = (int, float) if wanted is float else (wanted,)
        assert isinstance(value, kinds), where


def check_schema(schema: Mapping[str, Any], wanted: Any, where: str = "") -> None:
    """Assert that a JSON schema describes what was published."""
    if isinstance(wanted, Mapping):
        assert schema["type"] == "object", where
        assert set(schema.get("required", ())) == wanted.keys() == schema["properties"].keys(), where
        for key, kind in wanted.items():
            check_schema(schema["properties"][key], kind, f"{where}.{key}")
    elif isinstance(wanted, list):
        assert schema["type"] == "array", where
        check_schema(schema["items"], wanted[0], f"{where}[]")
    else:
        assert schema["type"] == _JSON_NAMES[wanted], where
