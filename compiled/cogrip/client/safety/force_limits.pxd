cimport cython

from cogrip.client.rows.row_size cimport change_surely_below
from cogrip.client.safety.thermal cimport ThermalLimit
from cogrip.machine.addition cimport add_floats


cdef class ForceLimits:
    cdef double _tick_s
    cdef object _note
    cdef public ThermalLimit thermal
    cdef double _soft_n
    cdef long long _soft_ticks
    cdef long long _soft_left
    cdef public tuple out
    cdef public bint limited
    cdef public bint derated
    cdef public bint over
    cdef public object bounds
    cdef double _peak_n
    cdef double _slope_n

    cpdef set_bounds(self, bounds)
    @cython.locals(most_n=double, scale=double, value=double)
    cpdef clip(self, force_n, double size_n)
    cpdef tuple follow(self, tuple wanted, bint gap, double fall)
    cpdef soften(self)
    @cython.locals(square=double, value=double, x=double, y=double, z=double)
    cpdef enter(self)
    cpdef correct(self, tuple force_n, bint goes_on)
    @cython.locals(out=tuple)
    cdef tuple _soften(self, tuple wanted, bint gap, double fall)
    @cython.locals(change=double, fraction=double, old=double, new=double)
    cdef tuple _slew(self, tuple wanted, double most_n, name)
