"""`byte_copy.py`, compiled: without an object for the place. It is a function of its own module, so that no compiler moves
what the caller writes behind it, a counter, ahead of it.
"""

from cpython.bytes cimport PyBytes_AS_STRING
from libc.string cimport memcpy


cpdef int copy_into(unsigned char[::1] target, Py_ssize_t start, bytes payload) except -1:
    cdef Py_ssize_t size = len(payload)
    if start < 0 or start + size > target.shape[0]:
        raise ValueError(f"{size} bytes at {start} do not fit into {target.shape[0]}")
    memcpy(&target[0] + start, PyBytes_AS_STRING(payload), size)
    return 0
