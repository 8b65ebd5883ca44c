cimport cython

from cogrip.protocol.wire.button_edges cimport EdgeReceiver
from cogrip.protocol.recording.sink cimport CoreRecorder
from cogrip.server.core cimport ServerCore
from cogrip.server.seats.participants cimport Seat
from cogrip.server.ports.port cimport Port
from cogrip.server.room cimport Room
from cogrip.server.worlds.world_step cimport WorldStep


cdef class RecordedServer(ServerCore):
    cdef CoreRecorder _recorder
    cdef public long long now_ns
    cdef object _hash_ticket
    cdef object _sent
    cdef public object start
    cdef public dict timing
    cdef dict _address_texts
    cdef dict _idle_steps
    cdef public object topics
    cdef dict _step_topic
    cdef dict _scene_topic
    cdef dict _sensor_topic
    cdef set _named
    cdef dict _drawn
    cdef Room _stepped
    cdef long long _frames
    cdef object _timed

    cpdef put(self, Py_ssize_t topic, record)
    cpdef note_timing(self, Room room, long long late_us, long long work_us, long long skipped)
    cpdef receive(self, bytes datagram, address, long long now_ns)
    cpdef tick(self, Room room, long long now_ns, long long frames=*)
    cpdef step(self, Room room, long long now_ns, long long frames=*)
    @cython.locals(seat=Seat, room=Room)
    cpdef finish_step(self)
    cdef _put_waiting(self)
    cpdef _put_sent(self, tuple entry)
    cpdef _text(self, address)


@cython.locals(seat=Seat, port=Port, handle=EdgeReceiver, world=WorldStep)
cdef _seat_step(Room room, Py_ssize_t number)
