from cogrip.protocol.io.dtls_session cimport DtlsSession


cdef class DtlsClient:
    cdef public object outbox
    cdef public object dropped
    cdef public object failed
    cdef object _fingerprint
    cdef object _wrong_fingerprint
    cdef object _hint
    cdef object _last_error
    cdef Py_ssize_t _attempts
    cdef long long _begun_ns
    cdef long long _answered_ns
    cdef object _context
    cdef object _association
    cdef DtlsSession _session
    cdef long long _written
    cdef long long _newest
    cdef bint _ready

    cpdef bint ready(self, address=*) except -1
    cpdef bint send(self, bytes message, address=*) except -1
    cdef _open(self, DtlsSession session, association, bytes datagram)
    cpdef poll(self, long long now_ns)
