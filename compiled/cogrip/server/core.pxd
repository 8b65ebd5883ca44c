cimport cython

from cogrip.protocol.line.received_waves cimport ReceivedWaves
from cogrip.server.seats.participants cimport Seat
from cogrip.server.room cimport Room


cdef class ServerCore:
    cdef public list rooms
    cdef public object _table
    cdef dict _places
    cdef ReceivedWaves _waves
    cdef public object _out
    cdef public object outbox
    cdef public object events
    cdef public object dropped
    cdef public object _drop
    cdef public object _joining
    cdef dict _handlers
    cdef long long _back_ns

    cpdef bint listens_to(self, address) except -1
    @cython.locals(place=tuple)
    cpdef receive(self, bytes datagram, address, long long now_ns)
    @cython.locals(seat=Seat)
    cpdef tick(self, Room room, long long now_ns, long long frames=*)
    @cython.locals(seat=Seat)
    cdef _let_silent_go(self, Room room, long long now_ns)
    @cython.locals(room=Room, seat=Seat, waves=ReceivedWaves)
    cdef bint _receive_waves(self, tuple place, bytes datagram, long long now_ns) except -1
    cdef _receive_from_seat(self, Room room, Seat seat, message, long long now_ns)
    cdef _receive_frame(self, Seat seat, message, long long now_ns)
