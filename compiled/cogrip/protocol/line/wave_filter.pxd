cimport cython


cdef class WaveFilter:
    cdef public list _content
    cdef tuple _newest
    cdef public double lag_ticks

    cpdef tuple step(self, tuple wave, long long ticks)
    cpdef cut(self, long long ticks)
    cdef _hold(self, long long ticks)
