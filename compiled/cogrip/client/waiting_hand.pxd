cdef class WaitingHand:
    cdef object _device
    cdef object _say
    cdef public long long ticks

    cpdef poll(self, long long tick, bint everybody)
