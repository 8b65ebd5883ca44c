cimport cython

from cogrip.client.safety.limiter cimport Safety
from cogrip.client.hand.velocity cimport MotionObserver
from cogrip.devices.plausibility cimport Plausibility
from cogrip.devices.sample cimport Sample


cdef class HandMotion:
    cdef double _rate_hz
    cdef double _tick_s
    cdef Safety _safety
    cdef long long _reckon_ticks
    cdef object _offset_m
    cdef long long _sampled
    cdef public bint begun
    cdef public tuple start_m
    cdef public tuple position_m
    cdef public object start_mps
    cdef public object velocity_mps
    cdef MotionObserver _observer
    cdef public Plausibility plausibility
    cdef public long long latency_ticks

    @cython.locals(taken="long long", age="long long", position=tuple, known=tuple, observer=MotionObserver)
    cpdef update(self, long long tick, long long elapsed, Sample sample, force_n)


@cython.locals(
    fx=double, fy=double, fz=double, at_x=double, at_y=double, at_z=double, x=double, y=double, z=double, dx=double,
    dy=double, dz=double, work=double, velocity=list, axis=Py_ssize_t, place=double, step=double,
)
cpdef tuple work_and_velocity(force_n, tuple start_m, tuple end_m, double rate_hz)
