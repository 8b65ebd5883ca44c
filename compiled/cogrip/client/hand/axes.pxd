from cogrip.devices.sample cimport Sample


cdef class AxisUnits:
    cdef public double length_scale
    cdef public bint further

    cpdef Sample lengths(self, Sample sample)
    cpdef pose(self, position_m)
    cpdef rates(self, rates)
    cpdef wrench(self, force_n)
