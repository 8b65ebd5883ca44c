cimport cython


cpdef bytes without_secrets(bytes message, ticket_hash)
@cython.locals(place=Py_ssize_t)
cdef bint _may_hold_any(bytes message) except -1
