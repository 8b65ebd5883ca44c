cdef class SentChanges:
    cdef public object holds
    cdef public long long taken
    cdef public object wanted
    cdef public object line
    cdef public object _told
    cdef public long long _reported
    cdef object _lines
    cdef long long _hz
    cdef long long _every

    cpdef due(self, long long session, long long step)
    cpdef list untold(self, long long session)
