from cogrip.server.rate_limit cimport RateLimiter


cpdef bint looks_like_hello(bytes datagram) except -1
