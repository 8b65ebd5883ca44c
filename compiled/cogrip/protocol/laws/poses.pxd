cdef class Places:
    cpdef list way(self, begin, end)
    cpdef list moved(self, begin, way)


cdef class Poses(Places):
    cdef public double length_m

    cpdef list way(self, begin, end)
    cpdef list moved(self, begin, way)
    cpdef list radians(self, row)
