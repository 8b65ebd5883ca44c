cimport cython

from cogrip.client.safety.force_limits cimport ForceLimits
from cogrip.client.rows.row_size cimport surely_below
from cogrip.machine.addition cimport add_floats


cdef class Safety:
    cdef object _length_scale
    cdef list _groups
    cdef ForceLimits _translation
    cdef ForceLimits _further
    cdef double _speed_mps
    cdef tuple _workspace_m
    cdef double _rise
    cdef double _fall
    cdef double _fault_fall
    cdef long long _stall_ticks
    cdef long long _watchdog_ticks
    cdef long long _limit_ticks
    cdef long long _derated_ticks
    cdef long long _let_go_ticks
    cdef public double gain
    cdef public object clamped_n
    cdef double _absent
    cdef long long _at_limit
    cdef long long _derated
    cdef long long _let_go
    cdef public bint limited
    cdef public bint derated
    cdef public str state
    cdef public object reason
    cdef public object warning
    cdef public object unstable
    cdef public object saturated
    cdef public object left
    cdef public object counts

    cpdef note(self, name)
    cpdef bint event(self, name, reason=*) except -1
    cpdef fail(self, reason)
    @cython.locals(
        square=double, other=double, x=double, y=double, z=double, at_x=double, at_y=double,
        at_z=double, place=double, speed=double, axis=Py_ssize_t, low=double, high=double,
    )
    cpdef bint check(self, long long ticks, position_m, velocity_mps) except -1
    cpdef double coming_gain(self, bint wished=*)
    @cython.locals(
        gain=double, translation=ForceLimits, further=ForceLimits, out=tuple, fall=double, over=bint, warm=bint,
    )
    cpdef tuple limit(self, force_n, bint gap=*)
    cpdef bint at_peak(self) except -1
    @cython.locals(size_n=double)
    cdef _clip(self, force_n)
