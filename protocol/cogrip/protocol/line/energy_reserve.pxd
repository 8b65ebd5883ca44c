cdef class EnergyReserve:
    cdef long long _left
    cdef double _now_j
    cdef public double least_j

    cpdef elapse(self, long long frames=*)
    cpdef update(self, double balance_j)
