"""`waves_encoding.py`, compiled: the same bytes, of the line's own numbers, without an object for each of them."""

from cpython.bytes cimport PyBytes_FromStringAndSize
from libc.string cimport memcpy

from cogrip.protocol.wire.clock cimport Clock
from cogrip.protocol.line.sender cimport LineSender

from cogrip.protocol.wire.messages import encode

cdef enum:
    TAG = 4
    FIELDS = 16  # and the tag
    MOST_HANDLE_BYTES = 512
    # waves, sums, energies and impedance, state, whole numbers; headers; handle
    MOST_BYTES = 9 * (192 + 2 * 6 + 4 + 18 + 12) + 32 + MOST_HANDLE_BYTES

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
    at = write_array(at, FIELDS + 1)
    at = write_whole(at, TAG)
    at = write_whole(at, session)
    at = write_whole(at, sender.next_number - count // axes)
    at = write_array(at, count)
    for place in range(oldest, count):
        at = write_float(at, values[place])
    for place in range(oldest):
        at = write_float(at, values[place])
    at = write_array(at, axes)
    for place in range(axes):
        at = write_float(at, sums[place])
    at = write_array(at, axes)
    for place in range(axes):
        at = write_float(at, sums[6 + place])
    at = write_float(at, made_j)
    at = write_float(at, port_j)
    at = write_whole(at, acknowledged)
    at = write_array(at, 3)
    at = write_whole(at, now_ns)
    at = write_whole(at, clock._peer_sent_ns)
    at = write_whole(at, clock.held_ns(now_ns))
    at = write_array(at, len(state))
    for value in state:
        at = write_float(at, value)
    at = write_whole(at, phase)
    at = write_whole(at, applied)
    at = write_float(at, impedance_nspm)
    at = write_whole(at, since)
    memcpy(at, <const char *>told, len(told))
    at = write_whole(at + len(told), edges)
    return PyBytes_FromStringAndSize(<char *>datagram, at - datagram)
