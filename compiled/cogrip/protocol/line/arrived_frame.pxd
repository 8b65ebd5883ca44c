from cogrip.protocol.line.received_waves cimport ReceivedWaves


cdef class ArrivedFrame:
    cdef public tuple wave
    cdef public bint has_ledger
    cdef public double made_j
    cdef public double port_j
    cdef public long long acknowledged

    cpdef set_ledger(self, ReceivedWaves datagram)
