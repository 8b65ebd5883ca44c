cdef inline double* numbers(double[::1] row) noexcept:
    return &row[0]
