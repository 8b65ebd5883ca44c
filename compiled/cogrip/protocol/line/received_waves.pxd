cdef class ReceivedWaves:
    cdef public long long session
    cdef public long long first
    cdef public Py_ssize_t numbers
    cdef public Py_ssize_t axes
    cdef public Py_ssize_t states
    cdef double[192] waves
    cdef double[6] total
    cdef double[6] squares
    cdef double[18] state
    cdef public double made_j
    cdef public double port_j
    cdef public long long acknowledged
    cdef public long long sent_ns
    cdef public long long echo_ns
    cdef public long long held_ns
    cdef public long long phase
    cdef public long long applied
    cdef public double impedance_nspm
    cdef public long long since
    cdef public long long edges

    cpdef bint decode(self, bytes datagram) except -1
    cpdef read(self, message)
    cpdef put(self, long long first, waves, total, squares, tuple metadata, long long phase)
    cpdef tuple frame(self, Py_ssize_t place)
    cpdef tuple total_row(self)
    cpdef tuple squares_row(self)
    cpdef tuple state_from(self, Py_ssize_t first, Py_ssize_t end)
