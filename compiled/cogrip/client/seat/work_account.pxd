cimport cython

from cogrip.client.coupling.interface cimport Coupling
from cogrip.protocol.line.energy_sums cimport CompensatedSum


cdef class WorkAccount:
    cdef public Coupling coupling
    cdef public double power_ratio
    cdef public CompensatedSum work
    cdef public double leak_j
    cdef public double least_leak_j
    cdef public double sources_j
    cdef public double closed_given_j
    cdef public double closed_port_j
    cdef public double closed_entered_j
    cdef object _reserve_j
    cdef long long _lost
    cdef object _count
    cdef object _playout
    cdef object _forces

    cpdef acting(self, long long elapsed, tuple force_n)
    @cython.locals(leak=double)
    cpdef compare(self)
    @cython.locals(port_j=double, lost="long long")
    cpdef tuple recorded(self)
    cpdef set_sources(self, double work_j)
