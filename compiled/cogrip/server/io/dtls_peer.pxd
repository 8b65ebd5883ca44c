cimport cython

from cogrip.protocol.io.dtls_session cimport DtlsSession


cdef class Peer:
    cdef public object association
    cdef public bytes nonce
    cdef public object address
    cdef public object network
    cdef public object records
    cdef public long long since_ns
    cdef public bint seated
    cdef public bint had_seat
    cdef public bint has_received
    cdef public long long requests
    cdef public long long most_requests
    cdef public long long newest
    cdef public long long written
    cdef public DtlsSession session
    cdef public object last_flight
    cdef public long long repeats


@cython.locals(size=Py_ssize_t)
cpdef bint is_of_session(bytes datagram) except -1
cpdef bint is_of_handshake(bytes datagram) except -1
