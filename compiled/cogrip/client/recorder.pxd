cimport cython

from cogrip.client.core cimport ClientCore
from cogrip.client.seat.seated cimport SeatedClient
from cogrip.client.tick_record cimport TickRecord
from cogrip.devices.sample cimport Sample
from cogrip.protocol.recording.sink cimport CoreRecorder


cdef class RecordedClient(ClientCore):
    cdef CoreRecorder _recorder
    cdef public object start
    cdef public tuple timing
    cdef Sample _sample
    cdef object _state
    cdef TickRecord _ticks

    cpdef _put_datagram(self, Py_ssize_t topic, bytes datagram)
    cpdef receive(self, datagram, long long now_ns)
    cpdef sense(self, long long tick, Sample sample, long long now_ns)
    @cython.locals(seat=SeatedClient, recorder=CoreRecorder, force=tuple, record=bytes)
    cpdef tuple act(self, long long now_ns)
