cimport cython

from cogrip.protocol.line.energy_sums cimport WaveSums


cdef class WaveLedger:
    cdef Py_ssize_t _axes
    cdef public double credit
    cdef public long long settled
    cdef public bint disturbed
    cdef WaveSums _played
    cdef WaveSums _filled
    cdef WaveSums _compensated
    cdef object _history
    cdef long long _cursor
    cdef tuple _nothing
    cdef dict _totals
    cdef tuple _usable
    cdef double[6] _lost
    cdef double[6] _lost_squares
    cdef public tuple settled_fillings

    @cython.locals(axis=Py_ssize_t, lost="double*", compensated=tuple)
    cpdef list position_deficit(self)
    cpdef add_totals(self, long long first, long long cursor, tuple total, tuple squares)
    @cython.locals(cursor="long long", first="long long", total=tuple, squares=tuple, newest=tuple)
    cpdef add_played(self, long long number, tuple frame)
    @cython.locals(
        ago="long long", played=tuple, played_squares=tuple, axis=Py_ssize_t, lost="double*", lost_squares="double*",
        sent=double, less=double, fraction=double,
    )
    cdef _settle(self, long long number, tuple total, tuple squares)
    cpdef add_filling(self, tuple frame)
    cpdef add_compensation(self, row, squares)
    @cython.locals(
        credit=double, filled_squares=tuple, compensated_squares=tuple, fillings=tuple, axis=Py_ssize_t, filled=double,
        spent=double, left=double, settled=double, fraction=double,
    )
    cpdef list allowances(self)
    cpdef list limits(self)
    @cython.locals(kept=double, left=double)
    cpdef list reserve(self)
