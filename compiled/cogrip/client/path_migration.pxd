cdef class PathMigration:
    cdef public object path
    cdef public object newer
    cdef public object attempts
    cdef Py_ssize_t _tries
    cdef long long _since_ns
    cdef bint _ready
    cdef object _resumed_ns

    cpdef bint due(self, long long now_ns, bint resuming, bint ready, bint refused) except -1
