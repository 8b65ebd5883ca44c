cimport cython

cdef unsigned long long _ALL_SEEN

cpdef bint is_one_message(bytes datagram) except -1


cdef class DtlsSession:
    cdef Py_ssize_t _explicit
    cdef object _read
    cdef object _write
    cdef bytes _read_iv
    cdef bytes _write_iv
    cdef long long _written
    cdef long long _newest
    cdef unsigned long long _seen
    cdef public bint closed

    cpdef bytes send(self, bytes message)
    cpdef bytes close(self)
    cpdef list receive(self, bytes datagram)
    @cython.locals(number="long long", place=Py_ssize_t, begin=Py_ssize_t, plain_bytes=Py_ssize_t, numbers=bytes)
    cdef _open(self, bytes record)
    @cython.locals(numbers=bytes, sealed=bytes, explicit=bytes)
    cdef bytes _record(self, bytes begin, bytes plain)
    cdef bytes _nonce(self, bytes iv, bytes place)
    @cython.locals(behind="long long")
    cdef bint _new(self, long long number)
    @cython.locals(ahead="long long", bit="unsigned long long")
    cdef _note(self, long long number)
