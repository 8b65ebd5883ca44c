cimport cython

from cogrip.client.coupling.interface cimport LatestStateCoupling
from cogrip.client.coupling.partner.hand_stiffness cimport HandStiffness
from cogrip.client.coupling.partner.intention cimport Intention
from cogrip.client.coupling.partner.release cimport Release
from cogrip.client.coupling.partner.spring_gate cimport SpringGate
from cogrip.client.coupling.partner.trust cimport Trust
from cogrip.machine.addition cimport add_products
from cogrip.protocol.laws.partner_model cimport Model, ahead, step_object
from cogrip.protocol.laws.poses cimport Places


cdef class Known:
    cdef public Model model
    cdef public Trust trust
    cdef public object intent
    cdef public double trusted_npm
    cdef public double age_s
    cdef public double silent_s
    cdef public double share
    cdef public object donated_j
    cdef public list stirred_m


cdef class PartnerCoupling(LatestStateCoupling):
    cdef public Places space
    cdef public double _tick_s
    cdef public tuple _spring
    cdef public double _mass_kg
    cdef public double _damping_nspm
    cdef public double _frame_s
    cdef public long long _others
    cdef public tuple _spring_now
    cdef public SpringGate gate
    cdef public bint _second
    cdef public object _fitted
    cdef public double _carried_nspm
    cdef public HandStiffness grip
    cdef public Intention intention
    cdef public Release release
    cdef public dict partners
    cdef public list place_m
    cdef public list velocity_mps
    cdef public object _at_m
    cdef public long long _elapsed
    cdef public double _here_s
    cdef public double _hold
    cdef public double _stored_j
    cdef public long long _clock_ns
    cdef public double _worked_j
    cdef public double _granted_j

    cpdef double given_j(self) except? -1.0
    @cython.locals(power=double)
    cpdef elapse(self, mean_velocity_mps, velocity_mps, double hold=*)
    cpdef elapse_absent(self)
    @cython.locals(reserve_j=double)
    cpdef long long end_frame(self, double spare_j=*) except? -1
    @cython.locals(known=Known, own=double, spring=double)
    cpdef long long start_frame(self) except? -1
    @cython.locals(known=Known, model=Model, share=double, axis=Py_ssize_t, moved=double)
    cpdef _stir(self)
    cpdef _own_m(self)
    @cython.locals(known=Known)
    cpdef _take(self, intent)
    cpdef double _age_s(self, intent) except? -1.0
    @cython.locals(
        K=double, B=double, ticks="long long", stretch=list, part=double, moved=list, force=list,
    )
    cpdef force(self, position_m, velocity_mps)
    cpdef list _stretch(self, position_m)
    @cython.locals(known=Known)
    cpdef _begin(self, position_m)
    cpdef _beginning(self, intent, place_m)
    @cython.locals(carried=double, K=double, B=double)
    cpdef tuple _rendered(self)
    @cython.locals(known=Known)
    cpdef _step(self, position_m, velocity_mps, double K, double B)
    @cython.locals(model=Model)
    cpdef Model _aged(self, Known known)
    @cython.locals(place=list, axis=Py_ssize_t, x=double, before=double, moved=double, kept=double)
    cpdef _yield(self, position_m, stretch, double part, long long ticks)
    @cython.locals(stiffness=double)
    cpdef bytes message(
        self, long long session, clock, long long now_ns, tuple origin_m, tuple position_m, velocity_mps, handle=*,
    )
    cpdef tuple _as_told(self, row)
    cpdef bint receive(self, message) except -1
