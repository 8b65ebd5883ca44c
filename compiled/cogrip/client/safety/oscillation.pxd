cimport cython


cdef class AxisTurns:
    cdef public bint positive
    cdef public bint rising
    cdef public double reversed_at
    cdef public double turned_at
    cdef public double extreme
    cdef public double sum_n
    cdef public double swing_n
    cdef public double swing_before_n
    cdef public double turned_n
    cdef public long long train
    cdef public long long reversals
    cdef public object fast


cdef class OscillationDetector:
    cdef long long _frame_ticks
    cdef long long _in_frame
    cdef list _axes
    cdef double _half_period
    cdef long long _window
    cdef double _most_at_limit
    cdef object _limited
    cdef long long _tick
    cdef double _forgets_at
    cdef public bint oscillates
    cdef public bint at_limit
    cdef public bint reverses

    @cython.locals(
        tick="long long", train=bint, changed=bint, ended=bint, number=Py_ssize_t, axis=AxisTurns, force=double, local=double, fast=bint,
        turned_fast=bint, swing=double, rings=bint, ended_n=double,
    )
    cpdef bint add(self, force_n, bint limited, local_n) except -1
    cdef _judge(self, long long tick)
    cpdef forget(self)
