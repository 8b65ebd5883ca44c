cimport cython

from cogrip.server.hosting.workers.paths cimport OpenPath, WorkerPort
from cogrip.server.rate_limit cimport RateLimiter


cdef class WorkerChannel:
    cdef public object outbox
    cdef public object events
    cdef public object renewed
    cdef public object failed
    cdef object _link
    cdef WorkerPort _port
    cdef RateLimiter _rate_limiter
    cdef object _seated
    cdef object _counts
    cdef long long _sweep_ns

    @cython.locals(path=OpenPath, messages=list)
    cpdef receive(self, bytes datagram, address, long long now_ns)
    @cython.locals(path=OpenPath)
    cpdef bint send(self, bytes message, address) except -1
    cdef str _fault(self, bytes datagram, address, long long now_ns)
    cdef bint _is_for_front(self, OpenPath path, bytes message) except -1
