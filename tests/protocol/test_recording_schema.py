"""JSON schemas of records: every field has a type that viewers know, a unit and a description."""

import base64
import json
from typing import Any

import pytest

from cogrip.protocol.drawing import TILE, Shape, Solid
from cogrip.protocol.recording.records import KINDS, Geoms, SeatStep, Step
from cogrip.protocol.recording.schema import DESCRIPTIONS, NOT_SHOWN, json_schema, unit_of
from cogrip.protocol.recording.sink import encode

TYPES: dict[str, Any] = {
    "object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": int | float
}  # fmt: skip
"""Those that viewers know."""


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """Return whether a value fits a schema: every key is there; null stands only where the schema has `nullable`."""
    kind = schema["type"]
    if value is None:
        return schema.get("nullable", False)
    if not isinstance(value, TYPES[kind]) or (isinstance(value, bool) and kind != "boolean"):
        return False
    if kind == "object":
        properties = schema["properties"]
        keys = set(schema["required"]) == set(properties) == value.keys() - set(NOT_SHOWN)
        return keys and all(fits(value[key], each) for key, each in properties.items())
    if kind == "array":
        return all(fits(each, schema["items"]) for each in value)
    if schema.get("contentEncoding") == "base64":
        base64.b64decode(value, validate=True)
    return True


SEAT = SeatStep("anna", True, (0.0, None), (0.0, 1.0), None, 0.5, 0.5, 0.5, 0)


def test_the_validator_tells_what_does_not_fit():
    schema = json.loads(json_schema(KINDS["step"]))
    whole = json.loads(encode(Step(1, (0.5,), (0.0,), (SEAT,))))
    assert fits(whole, schema)
    assert not fits([], schema)
    for wrong in (
        {"step": 1.5}, {"step": True}, {"step": None}, {"object_m": 0.5}, {"object_m": ["far"]}, {"more": 1},
        {"seats": [{**whole["seats"][0], "seated": 1}]}, {"seats": [{"user": "anna"}]},
    ):  # fmt: skip
        assert not fits({**whole, **wrong}, schema), wrong
    for key in whole:
        assert not fits({each: value for each, value in whole.items() if each != key}, schema), key


def viewer_types(schema: dict[str, Any]) -> None:
    """Rules of Foxglove's own parser of schemas, field by field: else it refuses the whole channel."""
    for name, field in schema["properties"].items():
        assert field["type"] in ("boolean", "string", "number", "integer", "object", "array"), name
        inner = field["items"] if field["type"] == "array" else field
        assert field["type"] != "array" or inner["type"] in ("boolean", "string", "number", "integer", "object"), name
        if inner["type"] == "object":
            viewer_types(inner)


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_field_has_a_type_that_viewers_know_a_unit_and_a_description(kind):
    schema = json.loads(json_schema(KINDS[kind]))
    viewer_types(schema)
    seats = schema["properties"].get("seats", {"items": {"properties": {}}})["items"]["properties"]
    for name, field in {**schema["properties"], **seats}.items():
        assert field["title"] == name
        assert name in DESCRIPTIONS, f"give {name} a line in cogrip.protocol.recording.schema"
        unit = unit_of(name)
        assert field["description"] == f"{DESCRIPTIONS[name]} [{unit}]" if unit else DESCRIPTIONS[name]
    assert set(seats) == ({"user", "seated"} | set(SeatStep.__struct_fields__) if kind == "step" else set())


def test_units_are_read_off_names():
    names = (
        "position_m",
        "object_mps",
        "work_us",
        "rtt_ms",
        "margin_j",
        "wave_up",
        "age_ticks",
        "ticks",
        "frames",
        "step",
    )
    assert [unit_of(name) for name in names] == ["m", "m/s", "µs", "ms", "J", "sqrt(W)", "device ticks", "", "", ""]


def test_a_shape_with_all_that_few_have_fits():
    shape = Shape(
        "plane",
        (0.0, 0.0, 0.1),
        colours=bytes(3 * TILE * TILE),
        period_m=(0.1, 0.1),
        solid=Solid((1.0, 0.005, 1e-4), (1, 1), (0.2,)),
    )
    assert fits(json.loads(encode(Geoms((shape,), (0.0, 0.0, 0.0)))), json.loads(json_schema(KINDS["geoms"])))
