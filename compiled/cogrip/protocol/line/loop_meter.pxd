cdef class LoopMeter:
    cdef long long _ticks_per_frame
    cdef object _last
    cdef object _counts
    cdef public long long implausible

    cpdef add(self, long long loop_ticks)
