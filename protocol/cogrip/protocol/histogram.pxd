cimport cython


cdef class DurationHistogram:
    cdef public object max_ns
    cdef public object total_ns
    cdef public long long[944] _counts

    @cython.locals(shift=Py_ssize_t, bin=Py_ssize_t)
    cpdef add(self, value_ns)
