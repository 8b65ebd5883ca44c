cimport cython


cdef class Decimator:
    cpdef push(self, wave)
    cpdef tuple take(self)


cdef class Boxcar(Decimator):
    cdef public list _sum
    cdef double _scale

    @cython.locals(total=list, x=double, y=double, z=double)
    cpdef push(self, wave)


cdef class Lowpass(Decimator):
    cdef public list _state
    cdef double _pole
    cdef double _gain


cdef class LastSample(Decimator):
    cdef tuple _last
