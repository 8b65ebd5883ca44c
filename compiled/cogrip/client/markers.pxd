cdef class Markers:
    cdef public long long refused
    cdef public bint everybody
    cdef long long _number
    cdef object _unanswered
    cdef long long _next_ns
    cdef object _known

    cpdef bint pending(self) except -1
