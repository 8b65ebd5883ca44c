cdef class CoreRecorder:
    cdef object _held
    cdef public object sink
    cdef object _encode
    cdef public bint keeps

    cpdef put(self, Py_ssize_t topic, long long time_ns, record)
