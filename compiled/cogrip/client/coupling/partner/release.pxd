cimport cython

from cogrip.machine.addition cimport add_products


cdef class Release:
    cdef Py_ssize_t _axes
    cdef object _drag
    cdef double _pole
    cdef double _inertia
    cdef double _grown
    cdef long long _lasting
    cdef public double share
    cdef public bint held
    cdef long long _free
    cdef list _force
    cdef list _speed

    cpdef begin(self)
    @cython.locals(
        pole=double, forces=list, speeds=list, hand=list, axis=Py_ssize_t, v=double, force=double, gained=double,
        own=double, loaded=double,
    )
    cpdef enter(self, velocity_mps, force_n)
