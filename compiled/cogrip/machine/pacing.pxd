cimport cython

from cogrip.machine.histogram cimport DurationHistogram


cdef class Pacer:
    cdef public long long rate_hz
    cdef public long long t0_ns
    cdef public long long spin_ns
    cdef public long long run
    cdef public long long skipped
    cdef public long long late_ns
    cdef public DurationHistogram lateness
    cdef public DurationHistogram work
    cdef object _clock
    cdef object _sleep
    cdef long long _next
    cdef public long long next_due_ns
    cdef public long long started_ns
    cdef bint _busy

    @cython.locals(seconds="long long", rest="long long")
    cpdef long long due_ns(self, long long tick) except? -1
    @cython.locals(seconds="long long", rest_ns="long long")
    cpdef long long tick_at(self, long long now_ns) except? -1
    @cython.locals(tick="long long", following_ns="long long", newest="long long")
    cpdef take(self, long long now_ns)
    @cython.locals(deadline_ns="long long", now_ns="long long", remaining_ns="long long")
    cpdef wait(self)
    cpdef done(self, long long early_ns=*)
    cpdef done_at(self, long long now_ns, long long early_ns)
