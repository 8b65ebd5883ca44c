"""Rows of numbers in plain floats: of so few, numpy's arrays would cost more than they save."""

from collections.abc import Sequence

Row = tuple[float, ...]  # one number for each axis
Floats = Sequence[float]  # one number for each axis, in whatever holds them
Vector = tuple[float, float, float]  # x, y, z
