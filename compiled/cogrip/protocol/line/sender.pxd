cimport cython

from cogrip.protocol.line.energy_sums cimport WaveSums


cdef class LineSender:
    cdef Py_ssize_t _axes
    cdef Py_ssize_t _capacity
    cdef Py_ssize_t _at
    cdef Py_ssize_t _count
    cdef WaveSums _before
    cdef public long long next_number
    cdef double[192] _values

    @cython.locals(values="double*", axes=Py_ssize_t, at=Py_ssize_t, axis=Py_ssize_t)
    cpdef push(self, tuple wave)
    @cython.locals(values="double*", count=Py_ssize_t, oldest=Py_ssize_t, place=Py_ssize_t, waves=list)
    cpdef tuple contents(self)
