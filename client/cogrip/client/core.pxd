cimport cython

from cogrip.client.seated cimport SeatedClient


cdef class Delays:
    cdef public object rtt
    cdef public object up
    cdef public object down
    cdef public object rtt_ms
    cdef public object up_ms
    cdef public object down_ms

    cpdef measure(self, stamp, session, long long now_ns)


cdef class ClientCore:
    cdef public object session
    cdef public Delays delays
    cdef public SeatedClient seated
    cdef public object account
    cdef public long long now_ns
    cdef public object markers
    cdef public list marked
    cdef object _capability
    cdef object _make_port

    @cython.locals(seated=SeatedClient)
    cpdef receive(self, datagram, long long now_ns)
    @cython.locals(seated=SeatedClient)
    cpdef sense(self, long long tick, sample, long long now_ns)
    cpdef tuple act(self, long long now_ns)
