cimport cython

from cogrip.protocol.io.dtls_session cimport DtlsSession


cdef class OpenPath:
    cdef public object address
    cdef public object socket
    cdef public object arrivals
    cdef public object sender
    cdef public DtlsSession session
    cdef public long long seated_ns
    cdef public bint closed


cdef class WorkerPort:
    cdef public dict paths
    cdef public bint from_front
    cdef public bint is_stray
    cdef public long long arrived_ns
    cdef public object renewed
    cdef public object dropped
    cdef object _link
    cdef object _stop
    cdef object _verdicts
    cdef object _orders
    cdef object _front_has_said
    cdef long long _drain_ns
    cdef bint _ask_front
    cdef bint _ask_own
    cdef bint _own_first
    cdef bint _begun
    cdef list _untried
    cdef list _tried
    cdef dict _addresses
    cdef bint _asked
    cdef object _overran
    cdef object _shared
    cdef object _own
    cdef object _ends

    @cython.locals(found=tuple)
    cpdef tuple receive(self, Py_ssize_t most_bytes, long long now_ns)
    cdef tuple _of_front(self, long long now_ns)
    @cython.locals(path=OpenPath)
    cdef tuple _of_own(self, Py_ssize_t most_bytes, long long now_ns)
    @cython.locals(path=OpenPath)
    cdef tuple _of_path(self, Py_ssize_t most_bytes, long long now_ns)
    cdef _begin(self)
