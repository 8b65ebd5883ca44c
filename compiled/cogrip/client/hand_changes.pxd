cdef class HandChanges:
    cdef public long long taken
    cdef public long long reported
    cdef public object holds
    cdef object _reports

    cpdef bint pending(self) except -1
