cimport cython

from cogrip.protocol.wire.clock cimport MessageClock
from cogrip.protocol.line.energy_reserve cimport EnergyReserve
from cogrip.protocol.line.received_waves cimport ReceivedWaves
from cogrip.server.seats.hand_changes cimport SentChanges
from cogrip.server.ports.port cimport Port


cdef class Participant:
    cdef public object number
    cdef public object name
    cdef public long long session
    cdef public object nonce
    cdef public object address
    cdef public long long last_received_ns
    cdef public long long since_ns
    cdef public long long asked_ns
    cdef public MessageClock clock
    cdef public object ticket
    cdef public object ticket_hash
    cdef public object token
    cdef public object hellos


cdef class Observer(Participant):
    pass


cdef class Seat(Participant):
    cdef public object settings
    cdef public object begins_with
    cdef public object spring
    cdef public object state
    cdef public object rtt_ns
    cdef public Port port
    cdef public object adapter
    cdef public object geometry
    cdef public SentChanges hand
    cdef public object effects
    cdef public bint on_object
    cdef public double line_margin_j
    cdef public EnergyReserve line_reserve
    cdef public object account
    cdef public object last
    cdef public list earlier
    cdef public object record
    cdef public object limits
    cdef public object reserved_until_ns
    cdef public bytes farewell
    cdef public long long farewell_ns
    cdef public double power_left
    cdef public double credit_left
    cdef public dict limited

    cpdef bint read_stamp(self, stamp, long long now_ns) except -1
    cpdef bint read_times(self, long long sent_ns, long long echo_ns, long long held_ns, long long now_ns) except -1
    @cython.locals(port=Port)
    cpdef bint take_in(self, ReceivedWaves datagram, long long now_ns) except -1
    @cython.locals(port=Port)
    cpdef bint receive(self, message, bint framed, long long now_ns) except -1
