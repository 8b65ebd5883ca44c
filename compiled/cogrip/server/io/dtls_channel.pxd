cimport cython

from cogrip.protocol.io.dtls_session cimport DtlsSession
from cogrip.server.io.dtls_peer cimport Peer
from cogrip.server.rate_limit cimport Buckets, RateLimiter


cdef class DtlsListener:
    cdef public object fingerprint
    cdef public object outbox
    cdef public object dropped
    cdef public object failed
    cdef public object events
    cdef public object renewed
    cdef RateLimiter _rate_limiter
    cdef object _seated
    cdef long long _most
    cdef bytes _secret
    cdef public tuple _cookies
    cdef object _context
    cdef object _listener
    cdef Buckets _event_budget
    cdef public dict _half
    cdef public dict _open
    cdef public dict _unseated
    cdef long long _sweep_ns
    cdef long long _handshakes

    @cython.locals(peer=Peer)
    cpdef bint send(self, bytes message, address) except -1
    @cython.locals(peer=Peer)
    cpdef receive(self, bytes datagram, address, long long now_ns)
    @cython.locals(session=DtlsSession)
    cdef _decrypt(self, Peer peer, bytes datagram, address, long long now_ns)
    @cython.locals(place=Py_ssize_t)
    cdef _bounded(self, received, address, long long now_ns)
