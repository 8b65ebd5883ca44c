"""`bit_length.py`, compiled: no object, no call of a method."""


cpdef int bit_length(long long number) noexcept:
    cdef int length = 0, step
    for step in (32, 16, 8, 4, 2, 1):
        if number >> step:
            number >>= step
            length += step
    return length + (number > 0)
