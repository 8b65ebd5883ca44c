cdef class UnencryptedChannel:
    cdef public object outbox
    cdef public object dropped
    cdef public object failed

    cpdef receive(self, bytes datagram, address, long long now_ns)
    cpdef bint send(self, bytes message, address) except -1
