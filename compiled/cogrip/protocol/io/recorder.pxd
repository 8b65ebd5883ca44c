from cogrip.machine.ring cimport Ring


cdef class Recorder:
    cdef public object path
    cdef public object trouble
    cdef public Ring ring
    cdef public object process
    cdef object _say
    cdef long long _count
    cdef bint _reported
    cdef object _unsaved

    cpdef put(self, Py_ssize_t topic, unsigned long long time_ns, bytes payload)
    cdef _check_writer(self, bint polls)
