cimport cython

from cogrip.client.hand_changes cimport HandChanges
from cogrip.client.markers cimport Markers
from cogrip.client.seat.seated cimport SeatedClient
from cogrip.devices.sample cimport Sample
from cogrip.machine.histogram cimport DurationHistogram
from cogrip.protocol.wire.session cimport ClientSession


cdef class Delays:
    cdef public DurationHistogram rtt
    cdef public DurationHistogram up
    cdef public DurationHistogram down
    cdef public object rtt_ms
    cdef public object up_ms
    cdef public object down_ms

    cpdef measure(self, stamp, session, long long now_ns)


cdef class ClientCore:
    cdef public ClientSession session
    cdef public Delays delays
    cdef public SeatedClient seated
    cdef public object account
    cdef public long long now_ns
    cdef public Markers markers
    cdef public list marked
    cdef object _capability
    cdef object _make_port

    @cython.locals(seated=SeatedClient, session=ClientSession)
    cpdef receive(self, datagram, long long now_ns)
    @cython.locals(seated=SeatedClient, session=ClientSession, changes=HandChanges)
    cpdef sense(self, long long tick, Sample sample, long long now_ns)
    cpdef tuple act(self, long long now_ns)
