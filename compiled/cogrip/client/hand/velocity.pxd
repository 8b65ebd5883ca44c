cimport cython


cdef class MotionObserver:
    cdef double _alpha
    cdef double _beta_rate
    cdef double _gamma_rate
    cdef double _tick_s
    cdef double[6] _per_mass
    cdef long long _late_ticks
    cdef public object _forces
    cdef public double[6] _estimate_m
    cdef public double[6] _accelerations
    cdef double[6] _impulse
    cdef public bint _begun
    cdef public list _velocity
    cdef public list _newest

    cpdef hold(self, force_n, long long ticks)
    @cython.locals(impulse="double*", axis=Py_ssize_t, x=double, y=double, z=double)
    cdef _push(self, force_n, long long ticks)
    @cython.locals(
        estimate="double*", velocity=list, push="double*", impulse="double*", step_s=double, alpha=double, beta_rate=double,
        gamma_rate=double, axis=Py_ssize_t, gained=double, predicted=double, error=double, per_mass="double*", tick_s=double,
    )
    cpdef list update(self, position_m, long long ticks=*)
    @cython.locals(velocity=list, newest=list, axis=Py_ssize_t, force_n=double, gained=double)
    cpdef list _now(self)
    cpdef reset(self)
