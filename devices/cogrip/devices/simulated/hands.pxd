cimport cython


cdef class DirectedHand:
    cdef public object stiffness_npm
    cdef public object damping_nspm
    cdef public object _course
    cdef public tuple _direction
    cdef public tuple _home
    cdef public object _rate_hz
    cdef public list _base

    @cython.locals(s=double, w=double, f=double, base=double, d=double)
    cpdef drive(self, tick)
