cimport cython


cdef class Shaking:
    cdef Py_ssize_t _axes
    cdef double _fraction
    cdef long long _window
    cdef double[3] _lower
    cdef double[3] _lowest
    cdef object _recent
    cdef bint _started
    cdef long long _left
    cdef double _sum
    cdef public double shake_n

    cpdef pause(self)
    @cython.locals(lower="double*", lowest="double*", fraction=double, axis=Py_ssize_t, total=double, low=double, high=double)
    cpdef enter(self, force_n)
    cdef _end_window(self)
