cdef class SeatEffects:
    cdef public bint present
    cdef public object asked_n
    cdef public double stored_j
    cdef public double work_j
    cdef public bint reduced

    cpdef begin_anew(self)
    cpdef enter(self, long long elapsed, held_n, acting_n, start_m, end_m)
    cpdef added(self, long long tick, coupling_n, hand_m, hand_mps, safety, port, frame)
    cpdef rest_of(self, force_n)
