cimport cython

from cogrip.protocol.line.energy_ledger cimport WaveLedger
from cogrip.protocol.laws.square_root cimport square_root


cpdef double clamped(double value, double least, double most)


cdef class Concealment:
    cdef public double line_quality
    cdef public double yielding_gain
    cdef public double[6] added
    cdef Py_ssize_t _axes
    cdef list _zero

    cpdef fill(self, last, limit, answer, late=*, bint silent=*, double part=*)
    cpdef compensate(self, tuple row, WaveLedger ledger, tuple last, bint gap)


cdef class DeficitCompensation(Concealment):
    @cython.locals(axis=Py_ssize_t, wanted=double)
    cpdef compensate(self, tuple row, WaveLedger ledger, tuple last, bint gap)


cdef class FadingConcealment(DeficitCompensation):
    @cython.locals(axis=Py_ssize_t, value=double, wave=double, reach=double)
    cpdef compensate(self, tuple row, WaveLedger ledger, tuple last, bint gap)


cdef class ElasticConcealment(Concealment):
    cdef double _fade
    cdef double _smoothing
    cdef double _deficit_fraction
    cdef double _dissipation_fraction
    cdef double _limit_fraction
    cdef double _gone
    cdef long long _gap_frames
    cdef long long _held_frames
    cdef double _stillness
    cdef bint _was_gap

    @cython.locals(axis=Py_ssize_t, square=double, along=double, speed_square=double, wave=double, speed=double)
    cdef double _stillness_of(self, tuple last, answer)
    @cython.locals(quality=double)
    cdef _recover(self)
    @cython.locals(
        smoothing=double, fraction=double, dissipation=double, after_gap=bint, axis=Py_ssize_t, value=double,
        axis_deficit=double, reserve_w=double, before=double, target=double, square=double, reach=double, size=double,
        p=double, deficits="double*", reserves="double*", added="double*",
    )
    cpdef compensate(self, tuple row, WaveLedger ledger, tuple last, bint gap)
