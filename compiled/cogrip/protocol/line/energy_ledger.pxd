cimport cython

from cogrip.protocol.line.energy_sums cimport WaveSums
from cogrip.protocol.line.received_waves cimport ReceivedWaves
from cogrip.protocol.laws.square_root cimport square_root


cdef class WaveLedger:
    cdef Py_ssize_t _axes
    cdef public double credit
    cdef public long long settled
    cdef public bint disturbed
    cdef WaveSums _played
    cdef WaveSums _filled
    cdef WaveSums _compensated
    cdef Py_ssize_t _rows
    cdef Py_ssize_t _row
    cdef double[::1] _history
    cdef double[::1] _nothing
    cdef long long _entered
    cdef long long _cursor
    cdef dict _totals
    cdef long long _usable
    cdef double[6] _usable_total
    cdef double[6] _usable_squares
    cdef double[6] _lost
    cdef double[6] _lost_squares
    cdef double[6] _settled_fillings
    cdef public double[6] deficits
    cdef public double[6] reserves

    @cython.locals(axis=Py_ssize_t)
    cdef _use(self, long long first, double* total, double* squares)
    @cython.locals(axis=Py_ssize_t, total=tuple, squares=tuple)
    cdef _use_kept(self, long long first, tuple totals)
    @cython.locals(first="long long")
    cpdef add_totals(self, ReceivedWaves datagram, long long cursor)
    @cython.locals(
        cursor="long long", first="long long", newest=tuple, history="double[::1]",
        played="double*", filled="double*", at=Py_ssize_t, axes=Py_ssize_t, axis=Py_ssize_t,
    )
    cpdef add_played(self, long long number, tuple frame)
    @cython.locals(
        before="double[::1]", longer="double[::1]", rows=Py_ssize_t, row=Py_ssize_t, split=Py_ssize_t, first=Py_ssize_t,
        end=Py_ssize_t, at=Py_ssize_t, to=Py_ssize_t, size=Py_ssize_t,
    )
    cdef _grow(self)
    @cython.locals(
        total="double*", squares="double*", history="double[::1]", at=Py_ssize_t, axes=Py_ssize_t, axis=Py_ssize_t,
        lost="double*", lost_squares="double*", sent=double, sent_square=double, less=double,
    )
    cdef _settle(self, long long number)
    cpdef add_filling(self, tuple frame)
    cpdef add_compensation(self, row, squares)
    cdef void compensated_by(self, double* row, double* squares) noexcept
    @cython.locals(credit=double, filled=double, spent=double, left=double)
    cdef double _allowance(self, Py_ssize_t axis) noexcept
    @cython.locals(axis=Py_ssize_t)
    cpdef list limits(self)
    @cython.locals(axis=Py_ssize_t, kept=double, left=double, lost="double*", compensated="double*")
    cpdef measure(self)
