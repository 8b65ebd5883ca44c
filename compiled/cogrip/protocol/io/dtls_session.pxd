cimport cython

cdef unsigned long long _ALL_SEEN

cpdef bint is_one_message(bytes datagram) except -1


cdef class DtlsSession:
    cdef Py_ssize_t _explicit
    cdef object _read
    cdef object _write
    cdef bytes _read_iv
    cdef bytes _write_iv
    cdef bytearray _nonce
    cdef bytearray _associated
    cdef bytearray _head
    cdef long long _written
    cdef long long _newest
    cdef unsigned long long _seen
    cdef public bint closed

    cpdef bytes send(self, bytes message)
    cpdef bytes close(self)
    cpdef list receive(self, bytes datagram)
    @cython.locals(number="long long", place=Py_ssize_t, begin=Py_ssize_t, plain_bytes=Py_ssize_t, plain=bytes)
    cdef _open(self, bytes record)
    @cython.locals(
        head="unsigned char*", explicit=Py_ssize_t, plain_bytes=Py_ssize_t, number="long long", length=Py_ssize_t,
        place=Py_ssize_t,
    )
    cdef bytes _record(self, unsigned char kind, bytes plain)
    @cython.locals(nonce="unsigned char*", associated="unsigned char*", place=Py_ssize_t)
    cdef _prepare(self, const unsigned char* iv, const unsigned char* record, Py_ssize_t at, Py_ssize_t plain_bytes)
    @cython.locals(behind="long long")
    cdef bint _new(self, long long number)
    @cython.locals(ahead="long long", bit="unsigned long long")
    cdef _note(self, long long number)
