cimport cython


cdef class Decimator:
    cpdef push(self, wave)
    cpdef tuple take(self)


cdef class Boxcar(Decimator):
    cdef Py_ssize_t _axes
    cdef public double[6] _sum
    cdef double _scale

    @cython.locals(total="double*", x=double, y=double, z=double, axis=Py_ssize_t)
    cpdef push(self, wave)
    @cython.locals(total="double*", scale=double, axis=Py_ssize_t)
    cpdef tuple take(self)


cdef class Lowpass(Decimator):
    cdef public list _state
    cdef double _pole
    cdef double _gain


cdef class LastSample(Decimator):
    cdef tuple _last
