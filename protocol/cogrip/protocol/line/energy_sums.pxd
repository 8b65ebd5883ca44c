cimport cython


cpdef double rounding_fraction(ticks_per_frame)


cdef class CompensatedSum:
    cdef public double value
    cdef double _error

    cpdef add(self, double term)


cdef class WaveSums:
    cdef public tuple total
    cdef public tuple squares
    cdef double[12] _errors

    @cython.locals(
        errors="double*", x=double, y=double, z=double, i=double, j=double, k=double, tx=double, ty=double, tz=double,
        sx=double, sy=double, sz=double, ux=double, uy=double, uz=double, px=double, py=double, pz=double,
        ax=double, ay=double, az=double, bx=double, by=double, bz=double,
        axis=Py_ssize_t, wave=double, before=double, square_before=double, term=double, after=double, square=double,
    )
    cpdef add(self, row, added=*)
