"""`bit_length.py`, compiled: an instruction of the processor, no object and no call of a method."""

cdef extern from *:
    """
    #if defined(_MSC_VER)
    #include <intrin.h>
    static int length_of(unsigned long long number) {
        unsigned long highest;
        return _BitScanReverse64(&highest, number) ? (int)highest + 1 : 0;
    }
    #else
    static int length_of(unsigned long long number) {
        return number ? 64 - __builtin_clzll(number) : 0;
    }
    #endif
    """
    int length_of(unsigned long long) nogil


cpdef int bit_length(long long number) noexcept:
    return length_of(number)
