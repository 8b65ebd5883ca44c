"""Square root of a float. Compiled, `square_root.pyx` takes its place."""

from math import sqrt as square_root

__all__ = ["square_root"]
