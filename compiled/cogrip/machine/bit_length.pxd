cpdef int bit_length(long long number) noexcept
