cimport cython


cdef class AlphaBeta:
    cdef double _alpha
    cdef double _beta_rate
    cdef double _tick_s
    cdef public double[6] _estimate_m
    cdef public bint _begun
    cdef public list _velocity

    @cython.locals(
        estimate="double*", velocity=list, step_s=double, alpha=double, beta_rate=double, axis=Py_ssize_t,
        predicted=double, error=double, x=double, y=double, z=double, px=double, py=double, pz=double, vx=double, vy=double,
        vz=double,
    )
    cpdef list update(self, position_m, long long ticks=*)
    cpdef reset(self)
