cimport cython

from cogrip.client.path_migration cimport PathMigration


cdef class NetworkPath:
    cdef public object server
    cdef public object socket
    cdef public object arrivals
    cdef public object channel
    cdef public bint refused
    cdef public bint met

    cpdef receive(self, long long now_ns)


cdef class Paths:
    cdef public object server
    cdef public object failed
    cdef public object make_channel
    cdef object _roams
    cdef object _counts
    cdef PathMigration _migration
    cdef bint _opened
    cdef bytes _hello
    cdef bytes _newest_hello
    cdef list _known
    cdef Py_ssize_t _asked
    cdef Py_ssize_t _redirects
    cdef long long _came_ns

    @cython.locals(path=NetworkPath)
    cpdef send(self, bytes message, bint hello=*)
    cdef bint _uses(self, path) except -1
    @cython.locals(arrived_ns="long long", came_ns="long long")
    cdef _drain_path(self, NetworkPath path, long long now_ns, take, answers, redirect)
    @cython.locals(newest=NetworkPath, ready=bint, just_met=bint)
    cpdef bint poll(self, long long now_ns, bint resuming) except -1
    cdef _run_timers(self, NetworkPath path, long long now_ns)
    cdef _flush(self, NetworkPath path)
