"""Decoder of one kind of message, an array of numbers and of lists of numbers: msgspec's, in a third of its time, compiled.

It takes what senders write: whole numbers in any length, floats of 64 bits, nil for what may be absent. For anything else it
gives None, and msgspec decides. Kinds and bounds of the fields are read from the struct itself.
"""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_GET_SIZE
from cpython.float cimport PyFloat_FromDouble
from cpython.ref cimport Py_INCREF
from cpython.tuple cimport PyTuple_New, PyTuple_SET_ITEM
from libc.stdint cimport uint64_t
from libc.string cimport memcpy

from msgspec import inspect

cdef enum:
    MOST = 32  # fields
    WHOLE = 0
    FLOAT = 1
    FLOATS = 2
    STRUCT = 3
    NOTHING = 4

cdef struct Field:
    int kind
    long long least, most  # of a whole number
    double low, high  # of a float
    Py_ssize_t fewest, furthest  # of a list


cdef class StructDecoder:
    """Decoder of an array-like struct. Raises TypeError for one that it cannot decode at all."""

    cdef object _type
    cdef int _tag, _count
    cdef Field[MOST] _fields
    cdef list _parts  # decoders of the structs within, by their fields' places

    def __init__(self, kind):
        info = inspect.type_info(kind)
        if not info.array_like or len(info.fields) >= MOST:
            raise TypeError(f"{kind.__name__} is no array of less than {MOST} fields")
        self._type, self._count, self._tag = kind, len(info.fields), -1 if info.tag is None else info.tag
        self._parts = [None] * self._count
        for place, field in enumerate(info.fields):
            self._plan(place, field.type)

    cdef _plan(self, Py_ssize_t place, kind):
        cdef Field *field = self._fields + place
        if isinstance(kind, inspect.IntType):
            field.kind, field.least, field.most = WHOLE, kind.ge, kind.le
        elif isinstance(kind, inspect.FloatType):
            field.kind, field.low, field.high = FLOAT, kind.ge, kind.le
        elif isinstance(kind, inspect.VarTupleType) and isinstance(kind.item_type, inspect.FloatType):
            field.kind, field.low, field.high = FLOATS, kind.item_type.ge, kind.item_type.le
            field.fewest, field.furthest = kind.min_length or 0, kind.max_length
        elif isinstance(kind, inspect.StructType):
            field.kind = STRUCT
            self._parts[place] = StructDecoder(kind.cls)
        elif isinstance(kind, inspect.UnionType) and any(isinstance(each, inspect.NoneType) for each in kind.types):
            field.kind = NOTHING
        else:
            raise TypeError(f"a field of {self._type.__name__} is {kind}")

    def decode(self, bytes datagram not None):
        """Return the struct, or None where msgspec has to decide."""
        cdef const unsigned char *at = <const unsigned char *>PyBytes_AS_STRING(datagram)
        cdef const unsigned char *end = at + PyBytes_GET_SIZE(datagram)
        found = self._struct(&at, end)
        return found if at == end else None

    cdef _struct(self, const unsigned char **at, const unsigned char *end):
        cdef int place
        cdef Field *field
        cdef long long whole
        cdef double number
        if _length(at, end) != self._count + (self._tag >= 0):
            return None
        if self._tag >= 0:
            if at[0] >= end or at[0][0] != self._tag:
                return None
            at[0] += 1
        cdef tuple values = PyTuple_New(self._count)
        for place in range(self._count):
            field = self._fields + place
            if field.kind == WHOLE:
                if not _whole(at, end, &whole) or not field.least <= whole <= field.most:
                    return None
                value = whole
            elif field.kind == FLOAT:
                if not _float(at, end, &number) or not field.low <= number <= field.high:
                    return None
                value = PyFloat_FromDouble(number)
            elif field.kind == FLOATS:
                value = _floats(at, end, field)
            elif field.kind == STRUCT:
                value = (<StructDecoder>self._parts[place])._struct(at, end)
            else:
                if at[0] >= end or at[0][0] != 0xC0:
                    return None
                at[0] += 1
                value = None
            if value is None and field.kind != NOTHING:
                return None
            Py_INCREF(value)
            PyTuple_SET_ITEM(values, place, value)
        return self._type(*values)


cdef Py_ssize_t _length(const unsigned char **at, const unsigned char *end):
    """Read the length of an array; -1 for anything else."""
    cdef const unsigned char *here = at[0]
    if here < end and here[0] & 0xF0 == 0x90:
        at[0] += 1
        return here[0] & 0x0F
    if end - here >= 3 and here[0] == 0xDC:
        at[0] += 3
        return here[1] << 8 | here[2]
    return -1


cdef bint _whole(const unsigned char **at, const unsigned char *end, long long *found):
    """Read a whole number below 2^63; False for anything else."""
    cdef const unsigned char *here = at[0]
    cdef int first, size, place
    cdef uint64_t bits = 0
    if here >= end:
        return False
    first = here[0]
    if first < 0x80 or first >= 0xE0:
        found[0] = first if first < 0x80 else first - 0x100
        at[0] += 1
        return True
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
    return True


cdef bint _float(const unsigned char **at, const unsigned char *end, double *found):
    """Read a float of 64 bits; False for anything else."""
    cdef const unsigned char *here = at[0]
    cdef uint64_t bits
    if end - here < 9 or here[0] != 0xCB:
        return False
    # one expression, which compilers make one load of
    bits = (
        <uint64_t>here[1] << 56 | <uint64_t>here[2] << 48 | <uint64_t>here[3] << 40 | <uint64_t>here[4] << 32
        | <uint64_t>here[5] << 24 | <uint64_t>here[6] << 16 | <uint64_t>here[7] << 8 | <uint64_t>here[8]
    )
    memcpy(found, &bits, 8)
    at[0] += 9
    return True


cdef _floats(const unsigned char **at, const unsigned char *end, Field *field):
    """Return a list of floats as a tuple, None for anything else."""
    cdef Py_ssize_t count = _length(at, end), place
    cdef double number
    if not field.fewest <= count <= field.furthest:
        return None
    cdef tuple found = PyTuple_New(count)
    for place in range(count):
        if not _float(at, end, &number) or not field.low <= number <= field.high:
            return None
        value = PyFloat_FromDouble(number)
        Py_INCREF(value)
        PyTuple_SET_ITEM(found, place, value)
    return found
