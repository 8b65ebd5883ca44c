cdef class HandFrame:
    cdef public object tool
    cdef public bint mapped
    cdef public bint turns
    cdef public bint held
    cdef public bint asked
    cdef public double power_ratio
    cdef public double stiffest
    cdef public long long button

    cpdef place(self, hand_m)
    cpdef rates(self, hand)
    cpdef shown(self, hand)
    cpdef hand_force(self, force_n)
    cpdef tool_force(self, force_n)
