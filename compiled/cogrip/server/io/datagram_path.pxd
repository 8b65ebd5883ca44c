cimport cython

from cogrip.server.core cimport ServerCore


cdef class DatagramPath:
    cdef object _port
    cdef object _channel
    cdef ServerCore _core
    cdef long long _limit_ns
    cdef public long long received
    cdef public long long sent
    cdef public long long cut_short

    @cython.locals(
        every="long long", count="long long", most="long long", limit_ns="long long", most_bytes=Py_ssize_t, datagram=bytes, core=ServerCore,
        arrived_ns="long long", message=bytes,
    )
    cpdef drain(self, long long now_ns, long long late_ns=*, long long until_ns=*)
    cpdef send(self)
    cpdef flush(self)
