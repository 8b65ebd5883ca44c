cimport cython

from cogrip.protocol.line.energy_sums cimport WaveSums


cdef class LineSender:
    cdef Py_ssize_t _axes
    cdef Py_ssize_t _capacity
    cdef list _values
    cdef WaveSums _before
    cdef public long long next_number

    cpdef push(self, tuple wave)
    cpdef tuple contents(self)
