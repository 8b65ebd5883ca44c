cimport cython

from cogrip.machine.pacing cimport Pacer
from cogrip.server.io.datagram_path cimport DatagramPath
from cogrip.server.recorder cimport RecordedServer
from cogrip.server.room cimport Room


cdef class PacedRoom:
    cdef public Room room
    cdef public Pacer pacer
    cdef public bint rested
    cdef long long _last
    cdef long long _steps
    cdef long long _work_us
    cdef long long _passed

    cpdef take(self, long long now_ns)
    @cython.locals(room=Room, pacer=Pacer, done_ns="long long")
    cpdef long long step(self, RecordedServer core, long long now_ns, long long early_ns) except -1
    @cython.locals(steps="long long")
    cpdef pass_by(self, long long now_ns)
    cpdef count_passed(self, RecordedServer core, long long now_ns)


@cython.locals(each=PacedRoom)
cpdef take_due(rooms, long long now_ns)


@cython.locals(each=PacedRoom, sent_ns="long long", done_ns="long long")
cpdef step_due(rooms, RecordedServer core, DatagramPath path, long long now_ns, long long early_ns)


@cython.locals(each=PacedRoom, found=list)
cpdef list deserted_among(rooms)


@cython.locals(each=PacedRoom, due_ns="long long")
cpdef long long next_due_ns(list rooms) except? -1
