cimport cython


cdef class Intention:
    cdef double _tick_s
    cdef double _mass_kg
    cdef double _pole
    cdef double _rate_pole
    cdef double _step_mps
    cdef double _spring_npm
    cdef public list place_m
    cdef public list rate_mps
    cdef list _rates
    cdef list _places
    cdef list _force
    cdef list _velocity

    cpdef begin(self, position_m)
    @cython.locals(
        pole=double, rate_pole=double, tick_s=double, places=list, forces=list, speeds=list, rates=list, compliance=double,
        inertia=double, place=list, rate=list, axis=Py_ssize_t, x=double, moved=double, pushed=double, gained=double, at=double,
        held=double, speed=double, moving=double, rough=double,
    )
    cpdef update(self, position_m, velocity_mps, force_n, double stiffness_npm=*)
