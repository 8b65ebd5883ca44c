"""`waves_encoding.py`, compiled: the same bytes, of the line's own numbers, without an object for each of them."""

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.stdint cimport uint64_t
from libc.string cimport memcpy

from cogrip.protocol.clock cimport Clock
from cogrip.protocol.line.sender cimport LineSender

from cogrip.protocol.messages import encode

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

cdef enum:
    TAG = 4
    FIELDS = 16  # and the tag
    MOST_HANDLE_BYTES = 512
    MOST_BYTES = 9 * (192 + 2 * 6 + 4 + 18 + 12) + 32 + MOST_HANDLE_BYTES  # waves, sums, energies and impedance, state, whole numbers; headers; handle
    FLOAT = 0xCB

cdef bytes NOTHING = b"\xc0"  # nil


cpdef bytes encode_waves(
    long long session, LineSender sender, double made_j, double port_j, long long acknowledged, Clock clock, long long now_ns,
    tuple state, long long phase, double impedance_nspm, long long since, long long edges,
    long long applied=0, handle=None,
):
    cdef unsigned char[MOST_BYTES] datagram
    cdef unsigned char *at = datagram
    cdef double *values = sender._values
    cdef double *sums = sender._before.sums
    cdef Py_ssize_t axes = sender._axes, count = sender._count, place
    cdef bytes told = NOTHING if handle is None else encode(handle)
    cdef Py_ssize_t oldest = sender._at if count == sender._capacity else 0
    if len(state) > 18:
        raise ValueError(f"a state of {len(state)} numbers")
    if len(told) > MOST_HANDLE_BYTES:
        raise ValueError(f"a handle of {len(told)} bytes")
    at = _array(at, FIELDS + 1)
    at = _whole(at, TAG)
    at = _whole(at, session)
    at = _whole(at, sender.next_number - count // axes)
    at = _array(at, count)
    for place in range(oldest, count):
        at = _float(at, values[place])
    for place in range(oldest):
        at = _float(at, values[place])
    at = _array(at, axes)
    for place in range(axes):
        at = _float(at, sums[place])
    at = _array(at, axes)
    for place in range(axes):
        at = _float(at, sums[6 + place])
    at = _float(at, made_j)
    at = _float(at, port_j)
    at = _whole(at, acknowledged)
    at = _array(at, 3)
    at = _whole(at, now_ns)
    at = _whole(at, clock._peer_sent_ns)
    at = _whole(at, clock.held_ns(now_ns))
    at = _array(at, len(state))
    for value in state:
        at = _float(at, value)
    at = _whole(at, phase)
    at = _whole(at, applied)
    at = _float(at, impedance_nspm)
    at = _whole(at, since)
    memcpy(at, <const char *>told, len(told))
    at = _whole(at + len(told), edges)
    return PyBytes_FromStringAndSize(<char *>datagram, at - datagram)


cdef inline unsigned char *_array(unsigned char *at, Py_ssize_t length) noexcept:
    """Write the header of an array."""
    if length < 16:
        at[0] = 0x90 | length
        return at + 1
    at[0], at[1], at[2] = 0xDC, length >> 8, length & 0xFF
    return at + 3


cdef inline unsigned char *_float(unsigned char *at, double number) noexcept:
    """Write a float of 64 bits."""
    cdef uint64_t bits
    memcpy(&bits, &number, 8)
    at[0] = FLOAT
    bits = big_endian(bits)
    memcpy(at + 1, &bits, 8)
    return at + 9


cdef inline unsigned char *_whole(unsigned char *at, long long number) noexcept:
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
