cimport cython


cdef class Shaking:
    cdef Py_ssize_t _axes
    cdef double[3] _first
    cdef double[3] _second
    cdef double[12] _kept
    cdef long long _window
    cdef object _recent
    cdef bint _started
    cdef long long _left
    cdef double _sum
    cdef public double shake_n

    cpdef pause(self)
    @cython.locals(
        kept="double*", c=double, a1=double, a2=double, d=double, b1=double, b2=double, axis=Py_ssize_t, at=Py_ssize_t,
        total=double, x=double, y=double, z=double,
    )
    cpdef enter(self, force_n)
    cdef _end_window(self)
