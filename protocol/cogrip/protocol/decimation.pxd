cimport cython


cdef class Decimator:
    cpdef push(self, wave)
    cpdef tuple take(self)


cdef class Boxcar(Decimator):
    cdef public list _sum
    cdef double _scale


cdef class Lowpass(Decimator):
    cdef list _state
    cdef double _pole
    cdef double _gain


cdef class LastSample(Decimator):
    cdef tuple _last
