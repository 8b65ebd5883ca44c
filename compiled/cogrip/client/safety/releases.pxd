cdef class Releases:
    cdef list _at
    cdef long long _left
    cdef long long _persists_ticks
    cdef public long long count
    cdef public long long ticks

    cpdef elapse(self)
