cimport cython

from cogrip.protocol.laws.poses cimport Places


cdef class Model:
    cdef public double age_s
    cdef public list drift_mps
    cdef public list intention_m
    cdef public list place_m
    cdef public Places space
    cdef public double stiffness_npm
    cdef public list velocity_mps

    @cython.locals(pole=double)
    cpdef follow(self, rate_mps, double passed_s)


cdef class ToolDrive:
    cdef list _drives
    cdef Model _model
    cdef double _share
    cdef double _step_s
    cdef public double damping_nspm
    cdef public list force_n

    cpdef end(self, velocity_mps)


@cython.locals(reach=double)
cpdef list ahead(intention_m, rate_mps, double age_s, Places space=*)

@cython.locals(
    K=double, B=double, G=double, stiff=double, damped=double, weight=double, model=Model, pull=double, inverse=double,
    carried=double, axis=Py_ssize_t, o=double, push=double, drive=double, x=double, force=double, v=double, speed=double,
    places=list, speeds=list, intended=list, drift=list, drives=list, shares=list,
)
cpdef step_object(
    double step_s, list place_m, list velocity_mps, double mass_kg, double damping_nspm, tuple spring, models, own=*,
)
