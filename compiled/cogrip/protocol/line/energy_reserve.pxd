cdef class EnergyReserve:
    cdef long long _left
    cdef public double newest_j
    cdef public double least_j

    cpdef elapse(self, long long frames=*)
    cpdef update(self, double newest_j)
