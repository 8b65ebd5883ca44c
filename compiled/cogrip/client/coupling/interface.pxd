cimport cython

from cogrip.machine.addition cimport add_floats
from cogrip.protocol.line.energy_reserve cimport EnergyReserve
from cogrip.protocol.line.energy_sums cimport CompensatedSum


cdef class PortEnergy:
    cdef CompensatedSum _made
    cdef CompensatedSum _used
    cdef double _stored_j
    cdef public double made_now_j
    cdef public double used_now_j

    cpdef end_frame(self)
    cpdef double port_j(self)


cdef class Coupling:
    cdef public object _seat
    cdef public long long frame_ticks
    cdef public object applied_n
    cdef public double carried_nspm
    cdef public double ramp_gain
    cdef public object cut_n
    cdef public object local_n
    cdef public bint reduced
    cdef public bint turns
    cdef public bint absorbs
    cdef public str implausible
    cdef public tuple still
    cdef public tuple returning
    cdef public tuple sent
    cdef public tuple object_state
    cdef public object down_margin_j
    cdef public EnergyReserve down_reserve

    cpdef bint gap(self) except -1
    cpdef double given_j(self) except? -1.0
    cpdef double pending_j(self) except? -1.0
    cpdef double entered_j(self) except? -1.0
    cpdef elapse(self, mean_velocity_mps, velocity_mps, double hold=*)
    cpdef elapse_held(self)
    cpdef elapse_absent(self)
    cpdef turn(self, tuple position_m, tuple rotation_rad)
    cpdef long long end_frame(self, double spare_j=*) except? -1
    cpdef long long start_frame(self) except? -1
    cpdef force(self, position_m, velocity_mps)
    cpdef bytes message(
        self, long long session, clock, long long now_ns, tuple origin_m, tuple position_m, velocity_mps, handle=*,
    )
    cpdef bint receive(self, message) except -1
    cpdef tuple recorded(self)


cdef class LatestStateCoupling(Coupling):
    cdef public object _receiver
    cdef public long long _number
    cdef public double _peak_n
    cdef public double _lag_s
