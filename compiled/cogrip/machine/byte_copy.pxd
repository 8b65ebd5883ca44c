cpdef int copy_into(unsigned char[::1] target, Py_ssize_t start, bytes payload) except -1
