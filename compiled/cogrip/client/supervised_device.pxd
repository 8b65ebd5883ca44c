cimport cython

from cogrip.devices.plausibility cimport ForceReports
from cogrip.devices.sample cimport Sample


cdef class SupervisedDevice:
    cdef public object device
    cdef object _spared
    cdef public object refusal
    cdef public object counts
    cdef object _core
    cdef object _rate_hz
    cdef double _tick_ns
    cdef public object _clock
    cdef object _starved
    cdef long long _starved_ns
    cdef object _record
    cdef Py_ssize_t _axes
    cdef bint _gives_velocity
    cdef ForceReports _reports
    cdef double _blocked_ns
    cdef str _slow
    cdef bint _failed
    cdef bint _arming
    cdef long long _first
    cdef long long _last
    cdef long long _begun

    @cython.locals(begun_ns="long long")
    cpdef read(self, long long tick)
    @cython.locals(begun_ns="long long")
    cpdef write(self, force_n)
    cdef _set_record(self, record)
    @cython.locals(axes=Py_ssize_t, fits=bint)
    cdef Sample _checked(self, sample)
    cdef _applied(self, tuple force_n)
    @cython.locals(tick_ns=double)
    cdef bint _blocks(self, str verb, long long took_ns) except -1
    cdef bint _was_starved(self, long long took_ns) except -1
    cdef _watch(self, bint sampled, long long tick)
    cdef _fail(self, verb, error)


cdef bint _plain(row) except -1
