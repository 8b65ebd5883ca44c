cimport cython

from cogrip.server.worlds.world_step cimport WorldStep


cdef class GripStep(WorldStep):
    cdef public Py_ssize_t users
    cdef public Py_ssize_t axes
    cdef double _frame_s
    cdef double _mass_kg
    cdef double _damping
    cdef public double[18] place
    cdef public double[18] speed
    cdef public double[18] external
    cdef public double[18] stretch
    cdef public double[18] force
    cdef public double[18] K
    cdef public double[18] B
    cdef public double[18] b
    cdef public double[18] c
    cdef double[18] _drive
    cdef double[18] _gain
    cdef double[18] _beta
    cdef double _beta_sum
    cdef public double[18] work
    cdef public double[18] excess
    cdef public double[18] paid
    cdef double[18] _waves
    cdef double[18] _mids
    cdef double[18] _taken
    cdef double[18] _sent
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
        mid=double, now=double, came=double, answers=list, sent="double*", squares=double, relatives=double,
        springs=double, stiffness=double, impedance=double, factor=double, wave=double, f=double, back=double,
        relative=double, work=double, before=double, total=double, taken=double, error=double,
    )
    cpdef list step(self, rows)
    @cython.locals(user=Py_ssize_t)
    cpdef save(self)
    @cython.locals(axis=Py_ssize_t)
    cdef bint _within(self, double most_m)
    cpdef moved(self)
    @cython.locals(axis=Py_ssize_t, axes=Py_ssize_t, place="double*", speed="double*", motion=tuple)
    cpdef tuple motion(self)
    @cython.locals(user=Py_ssize_t, work="double*")
    cpdef port_work_j(self)
    @cython.locals(axis=Py_ssize_t, force="double*", first=Py_ssize_t)
    cpdef tuple force_of(self, Py_ssize_t user)
    @cython.locals(axis=Py_ssize_t, place="double*", stretch="double*", first=Py_ssize_t)
    cpdef tuple proxy_of(self, Py_ssize_t user, offset)
