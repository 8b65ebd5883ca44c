cimport cython


cdef class Peaks:
    cdef public double force_n
    cdef public double further
    cdef public double step_n
    cdef public double travel_m

    @cython.locals(square=double, change=double, axis=Py_ssize_t, force=double, step=double)
    cpdef enter(self, tuple force_n, tuple before_n, axes)
    cdef _enter(self, double size_n, double step_n)
