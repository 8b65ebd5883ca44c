from cogrip.protocol.secure.channel cimport UnencryptedChannel
from cogrip.server.rate_limit cimport RateLimiter


cpdef bint looks_like_hello(bytes datagram) except -1


cdef class UnencryptedListener(UnencryptedChannel):
    cdef public object renewed
    cdef public object events
    cdef RateLimiter _rate_limiter
    cdef object _known

    cpdef receive(self, bytes datagram, address, long long now_ns)
