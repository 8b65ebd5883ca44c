"""JSON schemas of the records, in the plain form that viewers read: no references, no unions."""

from typing import Any

import msgspec
from msgspec import inspect

_NAMES = {
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.BoolType: "boolean",
}


def json_schema(record: type[msgspec.Struct]) -> bytes:
    """The schema of a record as JSON text."""
    return msgspec.json.encode({"title": record.__name__, **_schema(inspect.type_info(record))})


def _schema(kind: inspect.Type) -> dict[str, Any]:
    if isinstance(kind, inspect.UnionType):  # a missing value is left to the reader; viewers plot what is there
        return _schema(next(each for each in kind.types if not isinstance(each, inspect.NoneType)))
    if isinstance(kind, inspect.BytesType):
        return {"type": "string", "contentEncoding": "base64"}
    if isinstance(kind, inspect.VarTupleType):
        return {"type": "array", "items": _schema(kind.item_type)}
    if isinstance(kind, inspect.TupleType):
        return {"type": "array", "items": _schema(kind.item_types[0])}
    if isinstance(kind, inspect.StructType):
        return {"type": "object", "properties": {field.encode_name: _schema(field.type) for field in kind.fields}}
    return {"type": _NAMES[type(kind)]}
