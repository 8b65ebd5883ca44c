cimport cython


@cython.locals(total=double, value=double)
cpdef double add_floats(values) except? -1.0
@cython.locals(total=double, value=double, place=Py_ssize_t)
cpdef double add_products(a, b) except? -1.0
