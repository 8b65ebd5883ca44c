cimport cython


cdef class PhantomPlant:
    cdef object _settings
    cdef tuple _stops
    cdef public list position_m
    cdef public list velocity_mps
    cdef public long long saturated
    cdef object _rate_hz
    cdef double _p
    cdef double _q
    cdef double _g
    cdef double _h
    cdef double _k
    cdef double _friction
    cdef double _peak
    cdef list _weight

    @cython.locals(
        xs=list, vs=list, k=double, peak=double, c=double, p=double, q=double, g=double, h=double, weight=list, i=Py_ssize_t,
        low=double, high=double, x=double, v=double, force=double, drive=double, load=double, r=double, v_free=double,
        f=double, dx=double,
    )
    cpdef step(self, drive_n, force_n)
    @cython.locals(d=double, x=double)
    cpdef sense(self)
