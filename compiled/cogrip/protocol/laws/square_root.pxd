cpdef double square_root(double number) except? -1.0
