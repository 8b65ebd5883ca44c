cdef class EnergyReserve:
    cdef long long _left
    cdef public double balance_j
    cdef public double least_j

    cpdef elapse(self, long long frames=*)
    cpdef update(self, double balance_j)
