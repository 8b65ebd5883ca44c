cimport cython

from cogrip.machine.byte_copy cimport copy_into

cdef long long _HEAD_BYTES, _TOPIC_BITS, _DATA
cdef Py_ssize_t _PUT, _TAKEN, _LOST, _CLOSED, _SAID, _SAVED


cdef class Ring:
    cdef public int fd
    cdef object _map
    cdef unsigned char[::1] _bytes
    cdef unsigned long long[::1] _counters
    cdef unsigned long long[::1] _words
    cdef long long _capacity
    cdef long long _put
    cdef long long _taken
    cdef public long long lost
    cdef long long _marked
    cdef public long long missed

    cpdef put(self, Py_ssize_t topic, unsigned long long time_ns, bytes payload)
    @cython.locals(
        size="long long", need="long long", put="long long", capacity="long long", at="long long", room="long long",
        whole="long long", words="unsigned long long[::1]",
    )
    cdef bint _place(self, Py_ssize_t topic, unsigned long long time_ns, bytes payload) except -1
