cimport cython

from cogrip.machine.addition cimport add_products
from cogrip.protocol.laws.poses cimport Places


cdef class Trust:
    cdef double _frame_s
    cdef Places _space
    cdef object _past
    cdef double _pole
    cdef double _both
    cdef double _square
    cdef public double share

    cpdef enter(self, own_m, taken_m)
    @cython.locals(rough=double, back=Py_ssize_t, felt=list, right=list)
    cpdef learn(self, intention_m, double age_s)
    @cython.locals(series=double)
    cpdef double stiffness_npm(self, double told_npm, double own_npm, double spring_npm) except? -1.0
