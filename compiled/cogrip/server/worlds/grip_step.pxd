cimport cython

from cogrip.machine cimport in_place
from cogrip.server.worlds.world_step cimport WorldStep


cdef class GripStep(WorldStep):
    cdef public Py_ssize_t users
    cdef public Py_ssize_t axes
    cdef double _frame_s
    cdef public double mass_kg
    cdef public double damping
    cdef public double[::1] place
    cdef public double[::1] speed
    cdef public double[::1] external
    cdef public double[::1] stretch
    cdef public double[::1] force
    cdef public double[::1] K
    cdef public double[::1] B
    cdef public double[::1] b
    cdef public double[::1] c
    cdef public double[::1] target
    cdef public double[::1] held
    cdef public double[::1] adapts
    cdef double[::1] _drive
    cdef double[::1] _gain
    cdef double[::1] _beta
    cdef double _beta_sum
    cdef public double[::1] work
    cdef public double[::1] excess
    cdef public double[::1] paid
    cdef public double[::1] loan
    cdef double[::1] _waves
    cdef double[::1] _mids
    cdef double[::1] _taken
    cdef double[::1] _sent
    cdef public dict offsets
    cdef public bint settled
    cdef public bint growing
    cdef public bint saving
    cdef tuple _motion
    cdef public double error_j

    @cython.locals(beta_sum=double, G=double, gain=double, user=Py_ssize_t)
    cpdef settle(self)
    @cython.locals(
        users=Py_ssize_t, axes=Py_ssize_t, user=Py_ssize_t, axis=Py_ssize_t, at=Py_ssize_t, period=double, mass=double,
        K="double*", B="double*", b="double*", c="double*", drive="double*", gains="double*", betas="double*",
        place="double*", speed="double*", stretch="double*", waves="double*", mids="double*", inertia=double,
        weight=double, row=tuple, gained=double, lost=double, supplied=double, was=double, external=double, pull=double,
        mid=double, now=double, came=double, answers=list, sent="double*", force="double*", squares=double, relatives=double,
        springs=double, stiffness=double, impedance=double, factor=double, wave=double, f=double, back=double,
        relative=double, work=double, before=double, total=double, taken=double, error=double,
    )
    cpdef list step(self, rows)
    @cython.locals(user=Py_ssize_t, paid="double[::1]")
    cpdef grow(self)
    @cython.locals(at=Py_ssize_t, square=double, step=double)
    cdef _raise_stiffness(self, Py_ssize_t user, double target)
    @cython.locals(axis=Py_ssize_t)
    cdef bint _within(self, double most_m)
    cpdef moved(self)
    @cython.locals(axis=Py_ssize_t, axes=Py_ssize_t, place="double*", speed="double*", motion=tuple)
    cpdef tuple motion(self)
    @cython.locals(user=Py_ssize_t, work="double[::1]")
    cpdef port_work_j(self)
    @cython.locals(axis=Py_ssize_t, force="double*", first=Py_ssize_t)
    cpdef force_of(self, Py_ssize_t user)
    @cython.locals(axis=Py_ssize_t, place="double*", stretch="double*", first=Py_ssize_t, offset=tuple)
    cpdef proxy_of(self, Py_ssize_t user)
    cpdef contact_of(self, Py_ssize_t user)
