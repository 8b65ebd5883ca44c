from cogrip.server.seats.markers cimport RoomMarkers


cdef class RoomEffects:
    cdef double _frame_s
    cdef object _sections
    cdef list _users
    cdef list _marked
    cdef long long _looked
    cdef list _turns
    cdef list _effects
    cdef list _of
    cdef list _set
    cdef dict _set_step

    cpdef follow(self, long long step, RoomMarkers markers)
    cpdef tuple of(self, Py_ssize_t user)
