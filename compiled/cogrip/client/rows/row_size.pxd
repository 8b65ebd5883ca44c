cimport cython


@cython.locals(square=double, value=double)
cpdef bint surely_below(row, double most) except -1
@cython.locals(square=double, value=double, was=double, axis=Py_ssize_t)
cpdef bint change_surely_below(row, before, double most) except -1
