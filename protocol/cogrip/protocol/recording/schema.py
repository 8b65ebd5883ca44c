"""JSON schemas of the records, in the plain form that viewers read: no references, no unions, no arrays of arrays.

Foxglove refuses a whole channel for any of these. A field that may be null has the one type of its values and, as in
OpenAPI 3.0, `nullable`.
"""

from typing import Any

import msgspec
from msgspec import inspect

from cogrip.protocol.recording.descriptions import described

NOT_SHOWN = ("unfit",)
"""Fields that are in the messages and in no schema: an array of arrays."""

_NAMES = {
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
}


def json_schema(record: type[msgspec.Struct]) -> bytes:
    """Return the schema of a record as JSON text: every key that is always there, with its unit and what it means."""
    return msgspec.json.encode({"title": record.__name__, **_schema(inspect.type_info(record))})


def _schema(kind: inspect.Type) -> dict[str, Any]:
    if isinstance(kind, inspect.UnionType):
        value = next(each for each in kind.types if not isinstance(each, inspect.NoneType))
        return {**_schema(value), "nullable": True}
    if isinstance(kind, inspect.BytesType):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(kind, inspect.VarTupleType):
        return {"type": "array", "items": _schema(kind.item_type)}
    if isinstance(kind, inspect.StructType):
        fields = [field for field in kind.fields if field.name not in NOT_SHOWN]
        properties = {field.encode_name: _field(field) for field in fields}
        return {"type": "object", "properties": properties, "required": list(properties)}
    return {"type": _NAMES[type(kind)]}


def _field(field: inspect.Field) -> dict[str, Any]:
    text = described(field.name)
    return {"title": field.encode_name, **({"description": text} if text else {}), **_schema(field.type)}
