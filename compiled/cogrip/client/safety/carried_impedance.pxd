cimport cython

from cogrip.client.safety.oscillation cimport OscillationDetector


cdef class CarriedImpedance:
    cdef double _growth
    cdef double _retry_growth
    cdef long long _pause_ticks
    cdef long long _last_turn
    cdef double _retry_nspm
    cdef public double nspm
    cdef public double record_nspm
    cdef public OscillationDetector detector

    @cython.locals(carried=double, record=double, detector=OscillationDetector, local=double, turns=bint)
    cpdef adapt(self, long long tick, force_n, bint clipped, local_n, bint absorbs)
    cpdef come_back_with_less(self)
