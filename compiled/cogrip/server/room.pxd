cimport cython

from cogrip.protocol.wire.button_edges cimport EdgeReceiver
from cogrip.server.seats.effects cimport RoomEffects
from cogrip.server.seats.markers cimport RoomMarkers
from cogrip.server.seats.observers cimport ObserverSlots
from cogrip.server.seats.participants cimport Seat
from cogrip.server.ports.port cimport Port
from cogrip.server.worlds.world_step cimport WorldStep


cdef class Room:
    cdef public object settings
    cdef public object name
    cdef public object digest
    cdef public list seats
    cdef public object _scheme
    cdef public object frame
    cdef public bint takes_waves
    cdef public object world
    cdef public WorldStep world_step
    cdef tuple _idle_row
    cdef long long _frame_ns
    cdef Py_ssize_t _axes
    cdef Py_ssize_t _places
    cdef public ObserverSlots observer_slots
    cdef public RoomMarkers markers
    cdef public RoomEffects effects
    cdef public object _observer_effects
    cdef public list refused_effects
    cdef public long long steps
    cdef public object ticks
    cdef public double travel_m
    cdef public object unstable
    cdef public list left
    cdef public long long put_back
    cdef public object changes
    cdef public tuple _ramps
    cdef public object called
    cdef public object template
    cdef public object labels
    cdef public bint is_open
    cdef public tuple _saved

    @cython.locals(seat=Seat)
    cpdef bint is_deserted(self) except -1
    @cython.locals(seat=Seat)
    cpdef bint anybody_holds(self) except -1
    @cython.locals(seat=Seat, number=Py_ssize_t, out=list, state=tuple)
    cpdef list tick(self, long long now_ns, long long frames=*)
    @cython.locals(step=WorldStep, places=Py_ssize_t, before=tuple, here=tuple, failed=bint)
    cdef _advance(self, rows)
    @cython.locals(port=Port, axes=Py_ssize_t, port_out_j=double, reserve_j=double, seen=tuple)
    cdef _message_of(self, Seat seat, tuple answer, double work_j, tuple state, long long frames, long long now_ns)
    @cython.locals(
        seat=Seat, port=Port, number=Py_ssize_t, rows=list, row=tuple, next_step_ns="long long", missed="long long",
    )
    cdef list _pop(self, long long frames, long long now_ns)
    cdef _effects_of(self, Py_ssize_t number)
    cdef bint _has_effects(self, Seat seat) except -1
    cdef _give_handle(self, number, EdgeReceiver handle)
    @cython.locals(seat=Seat)
    cpdef tuple silent(self, long long now_ns)
