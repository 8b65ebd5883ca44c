cimport cython

from cogrip.client.safety.carried_impedance cimport CarriedImpedance
from cogrip.client.safety.oscillation cimport OscillationDetector
from cogrip.client.safety.releases cimport Releases
from cogrip.client.rows.row_size cimport surely_below


cdef class DevicePort:
    cdef public double _tick_s
    cdef public double balance_j
    cdef public double given_out_j
    cdef double _written_off_j
    cdef public double least_j
    cdef public double later_j
    cdef public double _given_j
    cdef public double _pending_j
    cdef public double _dissipated_j
    cdef public double _forgiven_j
    cdef public double _cut_j
    cdef public bint ramped
    cdef public bint oscillates
    cdef public long long _ticks
    cdef public long long _controlled
    cdef public long long _limited
    cdef public bint _changed
    cdef public long long _exhausted
    cdef public long long _tick
    cdef public CarriedImpedance carried
    cdef public Releases releases
    cdef public double lag_s
    cdef public double _damping
    cdef public double _friction_n
    cdef public double _count_m
    cdef public double _most_step_m
    cdef public double _free_j
    cdef public double _usable_j
    cdef public double reserve_j

    @cython.locals(balance=double, spare_j=double, taken_j=double, forgiven_j=double, earned_j=double)
    cpdef set_energies(self, double work_j, double given_j, double pending_j=*)
    @cython.locals(path_m=double, own_j=double, excess_j=double)
    cpdef end_frame(self, start_m, end_m, double frame_s, double stored_j)
    @cython.locals(left_j=double, size=double, most_n=double, force=double)
    cpdef damped(self, force_n, velocity_mps)
    cpdef limit(self, force_n)
    @cython.locals(
        carried=CarriedImpedance, detector=OscillationDetector, exhausted=bint,
    )
    cpdef watch(self, force_n, bint clipped, local_n, bint limited=*, bint reduced=*, bint absorbs=*)
    cpdef elapse(self)
    cpdef double left_j(self)
    cpdef rearm(self)
    cpdef _write_off(self)
