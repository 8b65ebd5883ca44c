cimport cython

from cogrip.server.seats.participants cimport Observer


cdef class ObserverSlots:
    cdef public object places
    cdef public dict observers
    cdef long long _every
    cdef long long _turn
    cdef object _bodies

    @cython.locals(each=Observer)
    cpdef silent(self, long long now_ns)
