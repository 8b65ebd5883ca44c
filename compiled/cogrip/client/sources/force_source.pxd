cdef class ForceSources:
    cdef tuple _all
    cdef public tuple present
    cdef public object wish_n
    cdef public object asked_n
    cdef public double potential_j
    cdef public double work_j
    cdef public bint reduced
