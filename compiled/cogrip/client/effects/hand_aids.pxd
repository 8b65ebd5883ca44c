cimport cython

from cogrip.machine.addition cimport add_floats


cdef class HandAids:
    cdef public object limit
    cdef object _asked
    cdef object _tick_s
    cdef object _extras
    cdef object _height_m
    cdef public double potential_j
    cdef object _record
    cdef Py_ssize_t _axes
    cdef tuple _zero
    cdef public tuple asked_n
    cdef public tuple extra_n
    cdef double _most_n
    cdef double _soft_m
    cdef double _stiffness_npm
    cdef double _damping_nspm
    cdef tuple _ball
    cdef object _box
    cdef double _weight_n
    cdef public bint active
