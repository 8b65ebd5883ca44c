cimport cython

from cogrip.machine.addition cimport add_products


cdef class HandStiffness:
    cdef Py_ssize_t _axes
    cdef double _tick_s
    cdef double _frame_s
    cdef Py_ssize_t _span
    cdef object _drag
    cdef public double stiffness_npm
    cdef public double known
    cdef double _zg
    cdef double _zx
    cdef double _zz
    cdef double _zr
    cdef list _sums
    cdef long long _ticks
    cdef object _begun_mps
    cdef object _newest_mps
    cdef list _moved
    cdef list _instrument
    cdef object _frames

    cpdef begin(self)
    @cython.locals(places=list, forces=list, speeds=list, axis=Py_ssize_t, x=double, y=double, z=double)
    cpdef enter(self, position_m, velocity_mps, force_n)
    cpdef stir(self, Py_ssize_t axis, double moved_m)
    @cython.locals(
        sums=list, ticks="long long", places=list, forces=list, speeds=list, pole=double, row=tuple, axis=Py_ssize_t,
        gained=double, speed=double, force=double,
    )
    cpdef end_frame(self)
    @cython.locals(
        square=double, weight=double, information=double, part=double, compliance=double, wanted=double, x=list, g=list, z=list,
        own=list,
    )
    cdef _learn(self)
