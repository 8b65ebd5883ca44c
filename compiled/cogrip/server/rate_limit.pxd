cimport cython


cdef class Buckets:
    cdef long long _each_ns
    cdef long long _all_ns
    cdef public long long[::1] _full_ns

    cpdef bint has(self, Py_ssize_t slot, long long now_ns) except -1
    @cython.locals(full_ns="long long")
    cpdef bint take(self, Py_ssize_t slot, long long now_ns) except -1


cdef class RateLimiter:
    cdef public bytes _secret
    cdef public Buckets _addresses
    cdef public Buckets _peers
    cdef dict _peer_slots
    cdef public Buckets _shaking
    cdef public object _seated_ns
    cdef public object _contact_ns
    cdef public object _handshake_ns
    cdef public Buckets _contacts
    cdef public Buckets _handshakes

    cpdef str size(self, bytes datagram)
    cpdef str peer(self, address, long long now_ns)
    cdef bint _take(self, Buckets budgets, let_ns, Py_ssize_t slot, long long now_ns) except -1
    cpdef Py_ssize_t _peer_slot(self, address) except -1
    cpdef Py_ssize_t _slot(self, address) except -1
