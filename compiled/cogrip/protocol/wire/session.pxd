cimport cython


cdef class ClientSession:
    cdef object _asked
    cdef public bytes hello
    cdef long long _since_ns
    cdef long long _next_ns
    cdef bytes _leave
    cdef public str state
    cdef public object outbox
    cdef public object clock
    cdef public object welcome
    cdef public object farewell
    cdef public long long last_received_ns
    cdef public long long fresh_ns
    cdef long long _reached_ns
    cdef bint _begun
    cdef public bint restarting
    cdef public long long give_up_ns
    cdef long long _wait_ns
    cdef public long long silence_ns
    cdef public long long resumed
    cdef public long long renewed
    cdef public object failed
    cdef public object ended
    cdef public object dropped

    cdef bint _step(self, str event) except -1
    cpdef drop(self, reason)
    cpdef receive(self, datagram, long long now_ns)
    cpdef mark_fresh(self, long long now_ns)
    cpdef bint stale(self, long long now_ns) except -1
    cpdef poll(self, long long now_ns)
    cdef _check_silence(self, long long silent_ns, long long now_ns)
    cdef _repeat(self, datagram, long long every_ns, long long now_ns)
    cpdef heartbeat(self, long long now_ns)
