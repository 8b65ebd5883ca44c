cdef class JitterBuffer:
    cdef public bint adapts
    cdef public long long repeated
    cdef public long long skipped

    cpdef long long begin(self, long long in_hand, long long early=*, long long phase=*)
    cpdef arrived(self, long long lead, long long early=*, long long phase=*)
    cpdef long long spare(self)
    cpdef long long decide(self, long long lead, bint present, bint fresh)
    cpdef delay(self)
    cpdef tuple depths(self)


cdef class FixedJitterBuffer(JitterBuffer):
    cdef public long long frames
    cdef public long long steps
    cdef long long _seen
    cdef long long _low
    cdef long long _high
    cdef long long _run


cdef class AdaptiveJitterBuffer(JitterBuffer):
    cdef double _late
    cdef long long _steps
    cdef long long _quantum
    cdef double _waits_above
    cdef long long _most_at_first
    cdef long long _offset
    cdef long long _phase
    cdef public object _recent
    cdef public list _sorted
    cdef long long _half
    cdef long long _most_now
    cdef long long _most_before
    cdef long long _since_skip
    cdef long long _too_long
    cdef long long _borders
    cdef long long _depth_sum
    cdef long long _deepest
    cdef long long _shallowest

    cdef _enter(self, long long x)
    cdef long long _target(self)
    cdef long long _move(self, long long lead, bint present)
    cdef long long _depth(self)
