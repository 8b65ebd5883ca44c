cdef class Markers:
    cdef long long _every
    cdef long long _steps
    cdef public object _told
    cdef long long _count
    cdef dict _left
    cdef long long _hz
    cdef dict _taken

    cpdef due(self, long long step)
