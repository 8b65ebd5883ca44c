"""`square_root.py`, compiled: the instruction of the processor, rounded in the same way."""

from libc.math cimport sqrt


cpdef double square_root(double number) except? -1.0:
    if number < 0.0:
        raise ValueError("math domain error")
    return sqrt(number)
