cdef class Sample:
    cdef readonly object position_m
    cdef readonly object velocity_mps
    cdef readonly object age_ticks
    cdef readonly object buttons
    cdef readonly object orientation
    cdef readonly object grip_m
