cimport cython


cdef class SeriesImpedance:
    cdef double _tick_s
    cdef public bint deflected
    cdef public list deflection_m

    cpdef reset(self)
    cpdef list with_spring(self, velocity_mps)
    @cython.locals(
        deflection=list, tick_s=double, behind=list, most=double, axis=Py_ssize_t, speed=double, port=double, z=double,
    )
    cpdef list port_velocity(self, velocity_mps, wave, double impedance, double per_wave, double ratio, cut_n)
