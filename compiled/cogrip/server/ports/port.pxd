from cogrip.protocol.wire.button_edges cimport EdgeReceiver
from cogrip.protocol.wire.clock cimport Clock
from cogrip.protocol.line.energy_reserve cimport EnergyReserve
from cogrip.protocol.line.received_waves cimport ReceivedWaves


cdef class Port:
    cdef public Py_ssize_t axes
    cdef public object impedance_nspm
    cdef public long long next_step_ns
    cdef public double absorbed_j
    cdef public object up_margin_j
    cdef public object proxy
    cdef public object turned
    cdef public object behind
    cdef public object loops
    cdef public double _rounding
    cdef public object origin
    cdef public object hand
    cdef public EnergyReserve up_reserve
    cdef public EdgeReceiver handle

    cpdef bint receive(self, message, long long now_ns) except -1
    cpdef bint take_in(self, ReceivedWaves datagram, long long now_ns) except -1
    cpdef tuple pop(self, long long frames)
    cpdef push(self, tuple row)
    cpdef bytes message(self, long long session, Clock clock, long long now_ns, tuple object_state, double port_j)
    cpdef port_in_j(self)
    cpdef double rounding_j(self) except? -1.0
