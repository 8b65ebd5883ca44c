"""Numbers of an array in place. Compiled, `in_place.pxd` takes its place: a C pointer, without a count of references."""

from array import array


def numbers(row: "array[float]") -> "array[float]":
    """Return the array itself."""
    return row
