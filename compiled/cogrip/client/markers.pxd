cdef class Markers:
    cdef public long long refused
    cdef public bint everybody
    cdef object _unanswered
    cdef object _known

    cpdef bint pending(self) except -1
