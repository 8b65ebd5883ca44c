cdef class HandChanges:
    cdef public long long taken
    cdef public long long reported
    cdef public object holds
    cdef long long _number
    cdef long long _answered
    cdef long long _next_ns

    cpdef bint pending(self) except -1
