cimport cython


cdef class ThermalLimit:
    cdef double _share
    cdef double _slope
    cdef public double rise
    cdef public bint warm
    cdef double _peak_n
    cdef double _square
    cdef double _acts_from
    cdef double _warm_from
    cdef public double limit_n

    @cython.locals(excess=double)
    cpdef set_limits(self, double peak_n, double continuous_n)
    @cython.locals(rise=double)
    cpdef enter(self, double square)
    cpdef correct(self, double entered, double square)
    cdef double _limit(self)
