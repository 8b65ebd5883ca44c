cimport cython

from cogrip.machine.bit_length cimport bit_length


cdef class DurationHistogram:
    cdef public long long max_ns
    cdef public object total_ns
    cdef public long long[944] _counts

    @cython.locals(shift=Py_ssize_t)
    cpdef add(self, long long value_ns)
