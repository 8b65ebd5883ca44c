"""`tick_packing.py`, compiled: the same bytes, without a struct for each tick."""

from cpython.bytes cimport PyBytes_AS_STRING, PyBytes_FromStringAndSize
from libc.string cimport memcpy

from cogrip.protocol.line.waves_encoding cimport write_array, write_float, write_whole

from cogrip.protocol.recording.records import Tick, TickHead
from cogrip.protocol.recording.sink import pack

cdef enum:
    MOST_AXES = 6
    MOST_HEAD_BYTES = 512

BEGIN = b"\xde" + len(Tick.__struct_fields__).to_bytes(2, "big")  # of a map with so many fields
cdef bytes FIRST = BEGIN  # a C variable: its bytes are copied without a look at the module
cdef list NAMES = [pack(name) for name in TickHead.__struct_fields__]


cpdef bytes pack_tick(
    long long tick, long long late_us, long long work_us, tuple position_m, tuple velocity_mps, tuple force_n, double work_j,
    double port_j, bytes rest, double device_reserve_j,
):
    cdef unsigned char[MOST_HEAD_BYTES] head
    cdef unsigned char[9] last
    cdef unsigned char *at = head
    cdef Py_ssize_t head_bytes, rest_bytes = len(rest)
    at = _text(at, FIRST)
    at = write_whole(_text(at, <bytes>NAMES[0]), tick)
    at = write_whole(_text(at, <bytes>NAMES[1]), late_us)
    at = write_whole(_text(at, <bytes>NAMES[2]), work_us)
    at = _text(at, <bytes>NAMES[3])
    if position_m is None:
        at[0] = 0xC0
        at += 1
    else:
        at = _row(at, position_m)
    at = _row(_text(at, <bytes>NAMES[4]), velocity_mps)
    at = _row(_text(at, <bytes>NAMES[5]), force_n)
    at = write_float(_text(at, <bytes>NAMES[6]), work_j)
    at = write_float(_text(at, <bytes>NAMES[7]), port_j)
    write_float(last, device_reserve_j)
    head_bytes = at - head
    cdef bytes made = PyBytes_FromStringAndSize(NULL, head_bytes + rest_bytes + 9)
    cdef char *to = PyBytes_AS_STRING(made)
    memcpy(to, head, head_bytes)
    memcpy(to + head_bytes, PyBytes_AS_STRING(rest), rest_bytes)
    memcpy(to + head_bytes + rest_bytes, last, 9)
    return made


cdef inline unsigned char *_text(unsigned char *at, bytes text) noexcept:
    """Copy bytes."""
    memcpy(at, PyBytes_AS_STRING(text), len(text))
    return at + len(text)


cdef inline unsigned char *_row(unsigned char *at, tuple row) except NULL:
    """Write a row of floats."""
    cdef double number
    if len(row) > MOST_AXES:
        raise ValueError(f"a row of {len(row)} numbers")
    at = write_array(at, len(row))
    for number in row:
        at = write_float(at, number)
    return at
