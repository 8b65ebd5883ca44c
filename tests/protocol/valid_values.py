"""Strategies of all that a type of the product allows: of messages, of records."""

from collections.abc import Mapping
from typing import Any

from hypothesis import strategies as st
from msgspec import inspect

Values = st.SearchStrategy[Any]
FINITE = st.floats(allow_nan=False, allow_infinity=False)
UNBOUNDED: dict[type, Values] = {
    inspect.BoolType: st.booleans(),
    inspect.BytesType: st.binary(max_size=60),
    inspect.NoneType: st.none(),
}


def valid(struct: type, special: Mapping[type, Values] = {}, free: Values = FINITE, **fields: Values) -> Values:
    """Return a strategy of a struct's values: numbers, texts and lists within the bounds of their types.

    special: strategies of structs that allow less than their fields do. free: of a float without a bound. fields: of fields
    of this struct.
    """

    def of(kind: inspect.Type) -> Values:
        match kind:
            case inspect.IntType(ge=low, le=high):
                return st.integers(-(2**63) if low is None else low, 2**64 - 1 if high is None else high)
            case inspect.FloatType(ge=low, le=high):
                return free if low is None and high is None else st.floats(low, high)
            case inspect.StrType(pattern=None, max_length=most):
                return st.text(max_size=min(most or 40, 40))
            case inspect.StrType(pattern=str(pattern), max_length=most):
                return st.from_regex(pattern).filter(lambda text: len(text) <= (most or 0))
            case inspect.LiteralType(values=values):
                return st.sampled_from(values)
            case inspect.UnionType(types=types):
                return st.one_of([of(each) for each in types])
            case inspect.TupleType(item_types=types):
                return st.tuples(*map(of, types))
            case inspect.VarTupleType(item_type=item, min_length=low, max_length=high):
                return st.lists(of(item), min_size=low or 0, max_size=6 if high is None else high).map(tuple)
            case inspect.StructType(cls=cls):
                return special[cls] if cls in special else valid(cls, special, free)
        return UNBOUNDED[type(kind)]

    info = inspect.type_info(struct)
    assert isinstance(info, inspect.StructType)
    return st.builds(struct, **{each.name: of(each.type) for each in info.fields if each.name not in fields}, **fields)
