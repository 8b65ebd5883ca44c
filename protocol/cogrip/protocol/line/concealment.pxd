cimport cython

from cogrip.protocol.square_root cimport square_root


cdef double _clamped(double value, double least, double most)


cdef class Concealment:
    cdef public double line_quality
    cdef public double yielding_gain
    cdef list _zero

    cpdef fill(self, last, limit, answer, late=*, bint silent=*)
    cpdef list compensate(self, tuple row, list deficit, list reserve, tuple last, bint gap)


cdef class DeficitCompensation(Concealment):
    pass


cdef class FadingConcealment(DeficitCompensation):
    pass


cdef class ElasticConcealment(Concealment):
    cdef double _fade
    cdef double _smoothing
    cdef double _deficit_fraction
    cdef double _dissipation_fraction
    cdef public list _compensation
    cdef double _limit_fraction
    cdef double _stillness
    cdef bint _was_gap

    @cython.locals(axis=Py_ssize_t, square=double, along=double, speed_square=double, wave=double, speed=double)
    cdef double _stillness_of(self, tuple last, answer)
    cdef _recover(self)
    @cython.locals(
        smoothing=double, fraction=double, dissipation=double, after_gap=bint, axis=Py_ssize_t, value=double,
        axis_deficit=double, reserve_w=double, before=double, target=double, square=double, reach=double, most=double,
        p=double, added=list,
    )
    cpdef list compensate(self, tuple row, list deficit, list reserve, tuple last, bint gap)
