from cogrip.client.hand.axes cimport AxisUnits
from cogrip.client.rows.row_size cimport change_surely_below, surely_below


cdef class Peaks:
    cdef public double force_n
    cdef public double further
    cdef public double step_n
    cdef public double travel_m

    cpdef enter(self, tuple force_n, tuple before_n, AxisUnits axes)
    cdef _enter(self, double size_n, double step_n)
