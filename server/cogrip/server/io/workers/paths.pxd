cimport cython

from cogrip.protocol.io.dtls_session cimport DtlsSession


cdef class OpenPath:
    cdef public object address
    cdef public object socket
    cdef public object arrivals
    cdef public object sender
    cdef public DtlsSession session
    cdef public long long seated_ns


cdef class WorkerPort:
    cdef public dict paths
    cdef public bint from_front
    cdef public long long arrived_ns
    cdef public object renewed
    cdef public object dropped
    cdef object _link
    cdef object _stop
    cdef object _verdicts
    cdef object _orders
    cdef dict _by_descriptor
    cdef int _front
    cdef object _readable
    cdef list _waiting
    cdef dict _busy
    cdef long long _tried_ns
    cdef bint _looked
    cdef dict _addresses
    cdef bint _asked
    cdef object _overran
    cdef object _batched

    @cython.locals(ready=int, path=OpenPath, looked=bint)
    cpdef tuple receive(self, Py_ssize_t most_bytes, long long now_ns)
    cdef bint _look(self, long long now_ns) except -1
