from libc.stdint cimport uint64_t
from libc.string cimport memcpy

from cogrip.protocol.wire.clock cimport Clock
from cogrip.protocol.line.sender cimport LineSender

cdef extern from *:
    """
    #include <stdint.h>
    #if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
    #define big_endian(bits) (bits)
    #elif defined(_MSC_VER)
    #include <stdlib.h>
    #define big_endian(bits) _byteswap_uint64(bits)
    #else
    #define big_endian(bits) __builtin_bswap64(bits)
    #endif
    """
    uint64_t big_endian(uint64_t) nogil


cpdef bytes encode_waves(
    long long session, LineSender sender, double made_j, double port_j, long long acknowledged, Clock clock, long long now_ns,
    tuple state, long long phase, double impedance_nspm, long long since, long long edges,
    long long applied=*, handle=*,
)


# Writers of MessagePack: each writes at `at` and returns the place behind.

cdef inline unsigned char *write_array(unsigned char *at, Py_ssize_t length) noexcept:
    """Write the header of an array."""
    if length < 16:
        at[0] = 0x90 | length
        return at + 1
    at[0], at[1], at[2] = 0xDC, length >> 8, length & 0xFF
    return at + 3


cdef inline unsigned char *write_float(unsigned char *at, double number) noexcept:
    """Write a float of 64 bits."""
    cdef uint64_t bits
    memcpy(&bits, &number, 8)
    at[0] = 0xCB
    bits = big_endian(bits)
    memcpy(at + 1, &bits, 8)
    return at + 9


cdef inline unsigned char *write_whole(unsigned char *at, long long number) noexcept:
    """Write a whole number in the fewest bytes."""
    cdef int size = 0, place
    if -32 <= number < 128:
        at[0] = number & 0xFF
        return at + 1
    if number >= 0:
        size = 0 if number < 1 << 8 else 1 if number < 1 << 16 else 2 if number < <long long>1 << 32 else 3
        at[0] = 0xCC | size
    else:
        size = 0 if number >= -(1 << 7) else 1 if number >= -(1 << 15) else 2 if number >= -(<long long>1 << 31) else 3
        at[0] = 0xD0 | size
    cdef int length = 1 << size
    for place in range(length):
        at[1 + place] = (number >> (8 * (length - 1 - place))) & 0xFF
    return at + 1 + length
