from cogrip.protocol.wire.session cimport ClientSession


cdef class Exchange:
    cdef ClientSession _session
    cdef object _paths
    cdef object _outbox
    cdef object _receive
    cdef object _answers
    cdef object _redirect
    cdef public object up
    cdef public object down
    cdef public long long half_tick_ns

    cpdef send(self, long long now_ns)
    cpdef drain(self, long long now_ns)
