cimport cython

from cogrip.machine.addition cimport add_products
from cogrip.protocol.line.energy_sums cimport CompensatedSum


cdef class SpringGate:
    cdef double _tick_s
    cdef public CompensatedSum work
    cdef public double donated_j
    cdef public double credited_j
    cdef public double refilled_j
    cdef public double spilt_j
    cdef public double granted_j
    cdef public double stored_j
    cdef public double _spare_before_j
    cdef double _coming_j
    cdef bint _reduced
    cdef double _rested_s
    cdef double _worked_j
    cdef bint _below
    cdef bint _gave_out
    cdef public long long ticks
    cdef public long long gated

    cpdef credit(self, double energy_j)
    @cython.locals(kept=double, most=double, square=double)
    cpdef double cut(self, stretch_m, double stiffness_npm) except? -1.0
    @cython.locals(
        stored=double, speed=double, part=double, before=double, budget=double, free=double, work=double, worked=double,
        size=double, take=double, given=double,
    )
    cpdef pay(self, stretch_m, double stiffness_npm, damper_n, velocity_mps, double damping_nspm)
    @cython.locals(given=double)
    cdef double _refill(self, double speed_mps, double free_j) except? -1.0
