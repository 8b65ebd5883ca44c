cimport cython


@cython.locals(total=double, value=double)
cpdef double add_floats(values) except? -1.0
