cimport cython

from cogrip.protocol.wire.clock cimport MessageClock
from cogrip.protocol.line.arrived_frame cimport ArrivedFrame
from cogrip.protocol.line.energy_sums cimport CompensatedSum
from cogrip.protocol.line.receiver cimport LineReceiver
from cogrip.protocol.line.sender cimport LineSender
from cogrip.protocol.line.received_waves cimport ReceivedWaves
from cogrip.protocol.line.waves_encoding cimport encode_waves
from cogrip.server.ports.port cimport Port
from cogrip.server.ports.seat_limits cimport WaveLimiter


cdef class WavePort(Port):
    cdef public double _half_frame_s
    cdef public LineReceiver _receiver
    cdef public LineSender _sender
    cdef long long _device_hz
    cdef long long _ticks_per_frame
    cdef tuple _neutral
    cdef bint _turning
    cdef Py_ssize_t _states
    cdef WaveLimiter _limiter
    cdef object _impedances
    cdef double _begun_nspm
    cdef long long _since
    cdef object _port_j
    cdef double _sent_j
    cdef CompensatedSum _made_j
    cdef dict _applied
    cdef dict _poses

    @cython.locals(axes=Py_ssize_t, newest="long long")
    cpdef bint take_in(self, ReceivedWaves datagram, long long now_ns) except -1
    @cython.locals(left_ns="long long")
    cdef long long _early(self, long long now_ns)
    @cython.locals(
        receiver=LineReceiver, metadata=ArrivedFrame, popped="long long", sent_j=double, margin=double, acknowledged="long long",
        behind="long long",
    )
    cpdef tuple pop(self, long long frames)
    cdef _set_impedance(self, impedance_nspm)
    @cython.locals(square=double, value=double)
    cpdef push(self, tuple row)
    cpdef port_in_j(self)
    cpdef double rounding_j(self) except? -1.0
    @cython.locals(receiver=LineReceiver)
    @cython.locals(receiver=LineReceiver)
    cpdef bytes message(self, long long session, MessageClock clock, long long now_ns, tuple object_state, double port_j)
