cimport cython

from cogrip.machine.addition cimport add_floats


cdef class PowerBucket:
    cdef double _frame_s
    cdef public double _refill_j
    cdef public double _burst_j
    cdef public double _level_j
    cdef public object counts


cdef class WaveLimiter(PowerBucket):
    cdef object _limits
    cdef double _ratio
    cdef double _impedance_nspm
    cdef double _largest_square
    cdef double _half_frame_s
    cdef double _brought
    cdef double _returned
    cdef public double taken_j

    @cython.locals(square=double, value=double, allowed=double, powered=double, gain=double)
    cpdef tuple limit(self, tuple wave)
    @cython.locals(square=double, value=double, level=double)
    cpdef book(self, tuple returned)


cdef class LineEnergyLimiter(PowerBucket):
    cdef bint _held
    cdef double _allowed_j
