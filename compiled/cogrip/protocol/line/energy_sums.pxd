cimport cython


cpdef double rounding_fraction(ticks_per_frame)


cdef class CompensatedSum:
    cdef public double value
    cdef double _error

    cpdef add(self, double term)


cdef class WaveSums:
    cdef Py_ssize_t _axes
    cdef public double[12] sums
    cdef double[12] _errors

    @cython.locals(axis=Py_ssize_t, sums="double*")
    cpdef tuple totals(self)
    @cython.locals(axis=Py_ssize_t, sums="double*")
    cpdef tuple square_sums(self)
    @cython.locals(
        sums="double*", errors="double*", x=double, y=double, z=double, i=double, j=double, k=double, tx=double, ty=double,
        tz=double, sx=double, sy=double, sz=double, ux=double, uy=double, uz=double, px=double, py=double, pz=double,
        ax=double, ay=double, az=double, bx=double, by=double, bz=double,
        axis=Py_ssize_t, wave=double, before=double, term=double, after=double, square=double,
    )
    cpdef add(self, row, added=*)
    @cython.locals(sums="double*", errors="double*", axis=Py_ssize_t, before=double, term=double, after=double)
    cdef void add_numbers(self, double* row, double* squares) noexcept
    @cython.locals(
        sums="double*", errors="double*", axis=Py_ssize_t, wave=double, before=double, term=double, after=double,
    )
    cdef void add_at(self, double* values, Py_ssize_t first) noexcept
