cdef class Driver:
    cdef public object _where
    cdef public object _axes
    cdef public tuple _zero
    cdef public object _counts
    cdef public bint _open
    cdef public long long _tick
