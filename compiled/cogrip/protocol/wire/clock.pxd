cimport cython


cdef class Clock:
    cdef long long _peer_sent_ns
    cdef long long _received_ns
    cdef long long _echoed_ns
    cdef long long _low_ns
    cdef long long _high_ns
    cdef bint _any
    cdef long long _read_ns
    cdef public object forward_ns
    cdef public object return_ns
    cdef public bint fresh
    cdef public long long contradictions
    cdef public long long implausible

    cpdef stamp(self, long long now_ns)
    cpdef long long held_ns(self, long long now_ns)
    cpdef read(self, stamp, long long now_ns)
    @cython.locals(
        rtt_ns="long long", low_ns="long long",
        high_ns="long long", least_ns="long long", most_ns="long long", way_ns="long long", kept_ns="long long",
        offset_ns="long long",
    )
    cpdef read_times(self, long long sent_ns, long long echo_ns, long long held_ns, long long now_ns)
