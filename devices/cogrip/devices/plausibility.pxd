cimport cython


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
    cdef list _ran
    cdef double _ran_ticks
    cdef list _last
    cdef long long _odd
    cdef double _jumps
    cdef public object _reported
    cdef double _reported_mps
    cdef list _drift
    cdef double _path
    cdef double _top
    cdef public object fault

    cpdef restart(self)
    @cython.locals(
        taken="long long", ticks="long long", step=list, square=double, x=double, y=double, z=double, then_x=double,
        then_y=double, then_z=double, moved=double,
    )
    cpdef judge(self, long long tick, sample)
    cdef double _most_m(self, double time_s, double late_s)
    @cython.locals(
        rate=double, x=double, y=double, z=double, rx=double, ry=double, rz=double, moved=double, ran=double,
    )
    cdef _move(self, list step, long long ticks)
