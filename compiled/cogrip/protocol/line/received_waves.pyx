"""`received_waves.py`, compiled: its numbers lie side by side, and it decodes what senders write.

That is whole numbers in any length, floats of 64 bits, and no handle. For anything else, and for what is out of the bounds of
`Waves`, msgspec decides.
"""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_GET_SIZE
from cpython.float cimport PyFloat_FromDouble
from cpython.ref cimport Py_INCREF
from cpython.tuple cimport PyTuple_New, PyTuple_SET_ITEM
from libc.stdint cimport uint64_t
from libc.string cimport memcpy

from msgspec import inspect

from cogrip.protocol.wire.messages import Stamp, Waves

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
    MOST_NUMBERS = 192  # waves of 32 frames
    MOST_AXES = 6
    MOST_STATE = 18
    FIELDS = 16  # and the tag
    TAG = 4
    NIL = 0xC0

cdef struct Bound:
    long long least, most  # of a whole number
    double low, high  # of a float
    Py_ssize_t fewest, furthest  # of a list

cdef Bound[FIELDS] BOUNDS  # of the fields of `Waves`, in order
cdef Bound[3] STAMP_BOUNDS


cdef _read_bounds(kind, Bound *bound):
    """Read the bounds of the fields of a struct."""
    for field in inspect.type_info(kind).fields:
        given = field.type
        if isinstance(given, inspect.IntType):
            bound.least, bound.most = given.ge, given.le
        elif isinstance(given, inspect.FloatType):
            bound.low, bound.high = given.ge, given.le
        elif isinstance(given, inspect.VarTupleType):
            bound.low, bound.high = given.item_type.ge, given.item_type.le
            bound.fewest, bound.furthest = given.min_length, given.max_length
        bound += 1


if len(inspect.type_info(Waves).fields) != FIELDS or len(inspect.type_info(Stamp).fields) != 3:
    raise TypeError("the fields of Waves are others than are decoded here")
_read_bounds(Waves, BOUNDS)
_read_bounds(Stamp, STAMP_BOUNDS)


cdef class ReceivedWaves:
    cpdef bint decode(self, bytes datagram) except -1:
        if datagram is None:
            raise TypeError("a datagram is None")
        cdef const unsigned char *at = <const unsigned char *>PyBytes_AS_STRING(datagram)
        cdef const unsigned char *end = at + PyBytes_GET_SIZE(datagram)
        cdef Py_ssize_t squares
        if _length(&at, end) != FIELDS + 1 or at >= end or at[0] != TAG:
            return False
        at += 1
        if not (
            _whole(&at, end, BOUNDS, &self.session)
            and _whole(&at, end, BOUNDS + 1, &self.first)
            and _floats(&at, end, BOUNDS + 2, self.waves, MOST_NUMBERS, &self.numbers)
            and _floats(&at, end, BOUNDS + 3, self.total, MOST_AXES, &self.axes)
            and _floats(&at, end, BOUNDS + 4, self.squares, MOST_AXES, &squares)
            and _float(&at, end, BOUNDS + 5, &self.made_j)
            and _float(&at, end, BOUNDS + 6, &self.port_j)
            and _whole(&at, end, BOUNDS + 7, &self.acknowledged)
            and _length(&at, end) == 3
            and _whole(&at, end, STAMP_BOUNDS, &self.sent_ns)
            and _whole(&at, end, STAMP_BOUNDS + 1, &self.echo_ns)
            and _whole(&at, end, STAMP_BOUNDS + 2, &self.held_ns)
            and _floats(&at, end, BOUNDS + 9, self.state, MOST_STATE, &self.states)
            and _whole(&at, end, BOUNDS + 10, &self.phase)
            and _whole(&at, end, BOUNDS + 11, &self.applied)
            and _float(&at, end, BOUNDS + 12, &self.impedance_nspm)
            and _whole(&at, end, BOUNDS + 13, &self.since)
            and at < end and at[0] == NIL
        ):
            return False
        at += 1
        if not _whole(&at, end, BOUNDS + 15, &self.edges):
            return False
        if squares != self.axes:
            self.axes = 0
        return at == end

    cpdef read(self, message):
        stamp = message.stamp
        self.session, self.sent_ns, self.echo_ns, self.held_ns = (
            message.session, stamp.sent_ns, stamp.echo_ns, stamp.held_ns,
        )
        self.states = _taken(message.state, self.state, MOST_STATE)
        self.applied, self.impedance_nspm = message.applied, message.impedance_nspm
        self.since, self.edges = message.since, message.edges
        metadata = (message.made_j, message.port_j, message.acknowledged)
        self.put(message.first, message.waves, message.total, message.squares, metadata, message.phase)

    cpdef put(self, long long first, waves, total, squares, tuple metadata, long long phase):
        self.first, self.phase = first, phase
        self.numbers = _taken(waves, self.waves, MOST_NUMBERS)
        self.axes = _taken(total, self.total, MOST_AXES)
        if _taken(squares, self.squares, MOST_AXES) != self.axes:
            self.axes = 0
        self.made_j, self.port_j, self.acknowledged = metadata

    cpdef tuple frame(self, Py_ssize_t place):
        return _row(self.waves + place * self.axes, self.axes)

    cpdef tuple total_row(self):
        return _row(self.total, self.axes)

    cpdef tuple squares_row(self):
        return _row(self.squares, self.axes)

    cpdef tuple state_from(self, Py_ssize_t first, Py_ssize_t end):
        if not 0 <= first <= end <= self.states:
            raise IndexError(f"numbers {first} to {end} of a state of {self.states}")
        return _row(self.state + first, end - first)


cdef Py_ssize_t _taken(row, double *to, Py_ssize_t most) except -1:
    """Copy a row. Returns its length, 0 for one that is too long for any line."""
    cdef Py_ssize_t place = 0, length = len(row)
    if length > most:
        return 0
    for value in row:
        to[place] = value
        place += 1
    return length


cdef tuple _row(double *values, Py_ssize_t length):
    cdef tuple found = PyTuple_New(length)
    cdef Py_ssize_t place
    for place in range(length):
        value = PyFloat_FromDouble(values[place])
        Py_INCREF(value)
        PyTuple_SET_ITEM(found, place, value)
    return found


cdef inline Py_ssize_t _length(const unsigned char **at, const unsigned char *end) noexcept:
    """Read the length of an array; -1 for anything else."""
    cdef const unsigned char *here = at[0]
    if here < end and here[0] & 0xF0 == 0x90:
        at[0] += 1
        return here[0] & 0x0F
    if end - here >= 3 and here[0] == 0xDC:
        at[0] += 3
        return here[1] << 8 | here[2]
    return -1


cdef inline bint _whole(const unsigned char **at, const unsigned char *end, Bound *bound, long long *found) noexcept:
    """Read a whole number within bounds; False for anything else."""
    cdef const unsigned char *here = at[0]
    cdef int first, size, place
    cdef uint64_t bits = 0
    if here >= end:
        return False
    first = here[0]
    if first < 0x80 or first >= 0xE0:
        found[0] = first if first < 0x80 else first - 0x100
        at[0] += 1
        return bound.least <= found[0] <= bound.most
    if not 0xCC <= first <= 0xD3:
        return False
    size = 1 << (first & 3)
    if end - here <= size:
        return False
    if first >= 0xD0 and here[1] & 0x80:
        bits = <uint64_t>-1
    elif first == 0xCF and here[1] & 0x80:
        return False
    for place in range(1, size + 1):
        bits = bits << 8 | here[place]
    found[0] = <long long>bits
    at[0] += size + 1
    return bound.least <= found[0] <= bound.most


cdef inline bint _number(const unsigned char **at, const unsigned char *end, double low, double high, double *found) noexcept:
    """Read a float of 64 bits within bounds; False for anything else, a number that is none among it."""
    cdef const unsigned char *here = at[0]
    cdef uint64_t bits
    if end - here < 9 or here[0] != 0xCB:
        return False
    memcpy(&bits, here + 1, 8)
    bits = big_endian(bits)
    memcpy(found, &bits, 8)
    at[0] += 9
    return low <= found[0] <= high


cdef inline bint _float(const unsigned char **at, const unsigned char *end, Bound *bound, double *found) noexcept:
    return _number(at, end, bound.low, bound.high, found)


cdef bint _floats(
    const unsigned char **at, const unsigned char *end, Bound *bound, double *found, Py_ssize_t most, Py_ssize_t *length,
) noexcept:
    """Read a list of floats within bounds; False for anything else."""
    cdef Py_ssize_t count = _length(at, end), place
    if not bound.fewest <= count <= bound.furthest or count > most:
        return False
    for place in range(count):
        if not _number(at, end, bound.low, bound.high, found + place):
            return False
    length[0] = count
    return True
