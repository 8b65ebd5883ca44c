cimport cython


cdef class EdgeReceiver:
    cdef public long long taken
    cdef public long long buttons
    cdef public tuple popped
    cdef public object orientation
    cdef public object grip_m
    cdef object _waiting
    cdef long long _newest_ns

    cpdef bint receive(self, handle, long long sent_ns) except -1
    cpdef tuple pop(self)
