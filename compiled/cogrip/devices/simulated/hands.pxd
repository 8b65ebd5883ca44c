cimport cython


cdef class DirectedHand:
    cdef public double stiffness_npm
    cdef public double damping_nspm
    cdef public object _course
    cdef public tuple _direction
    cdef public tuple _home
    cdef public object _rate_hz
    cdef public list _base

    @cython.locals(s=double, w=double, f=double, base=double, d=double)
    cpdef drive(self, tick)


@cython.locals(n="long long", zz=double, s=double, w=double)
cdef tuple _stroke_at(double z, double strokes, double part, double amplitude, double speed, double end)
