cdef class WorldStep:
    cdef object _world

    cpdef advance(self, rows)
    cpdef tuple motion(self)
    cpdef proxy_of(self, Py_ssize_t user)
    cpdef force_of(self, Py_ssize_t user)
    cpdef contact_of(self, Py_ssize_t user)
    cpdef port_work_j(self)
    cpdef tuple engaged_at(self, Py_ssize_t user)
    cpdef effects_of(self, Py_ssize_t user)
    cpdef take_events(self)
    cpdef bint left_workspace(self) except -1
    cpdef bint out_of_reach(self) except -1
