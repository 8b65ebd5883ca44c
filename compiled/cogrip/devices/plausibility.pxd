cimport cython

from cogrip.devices.sample cimport Sample
from cogrip.machine.addition cimport add_floats


@cython.locals(axis=Py_ssize_t)
cdef double _length(double* row, Py_ssize_t axes) except? -1.0


cdef class Plausibility:
    cdef double _tick_s
    cdef double _half_tick_s
    cdef double _kept
    cdef double _motors_mps2
    cdef double _slack_m
    cdef double _drift_m
    cdef double _path_m
    cdef long long _gap_ticks
    cdef long long _most_age
    cdef Py_ssize_t _axes
    cdef object _tick
    cdef double _quick
    cdef object _at
    cdef long long _taken
    cdef double[6] _step
    cdef double[6] _ran
    cdef double _ran_ticks
    cdef double[6] _last
    cdef long long _odd
    cdef double _jumps
    cdef public object _reported
    cdef double _reported_mps
    cdef double[6] _drift
    cdef double _path
    cdef double _top
    cdef public object fault

    cpdef restart(self)
    @cython.locals(
        taken="long long", ticks="long long", step="double*", square=double, x=double,
        y=double, z=double, then_x=double, then_y=double, then_z=double, moved=double, axis=Py_ssize_t,
    )
    cpdef judge(self, long long tick, Sample sample)
    cdef double _most_m(self, double time_s, double late_s)
    @cython.locals(
        fewest=double, rate=double, ahead_s=double, behind_s=double, square=double, axis=Py_ssize_t, moved=double,
        speed=double, last=double, high=double, low=double, off=double,
    )
    cdef bint _jumped(self, long long ticks) except -1
    @cython.locals(
        rate=double, step="double*", last="double*", ran="double*", known=bint, axis=Py_ssize_t, moved=double, x=double,
        y=double, z=double,
    )
    cdef _move(self, long long ticks)
    @cython.locals(half_s=double, keep=double, axis=Py_ssize_t)
    cdef _denied(self, reported, long long ticks)


cdef class ForceReports:
    cdef double _slack_n
    cdef object _asked
    cdef readonly object asked
    cdef double _odd
    cdef public object fault
