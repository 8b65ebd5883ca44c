cimport cython

from cogrip.devices.driver cimport Driver


cdef class SimulatedDevice(Driver):
    cdef public object capability
    cdef object _plant
    cdef object _step
    cdef object _sense
    cdef object _hand
    cdef object _drive
    cdef public object presses
    cdef public list _spans
    cdef public object _start_m
    cdef public object _force
    cdef public long long _begins
    cdef public bint _waits
    cdef double _let_go_s
    cdef double _last_held

    @cython.locals(last="long long", begins="long long", k="long long", at="long long", last_held=double)
    cpdef read(self, long long tick)
    @cython.locals(total=double, part=double)
    cpdef write(self, force_n)
