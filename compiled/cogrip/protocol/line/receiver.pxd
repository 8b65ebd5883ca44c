cimport cython

from cogrip.protocol.line.arrived_frame cimport ArrivedFrame
from cogrip.protocol.line.concealment cimport Concealment, clamped
from cogrip.protocol.line.energy_ledger cimport WaveLedger
from cogrip.protocol.line.energy_sums cimport CompensatedSum
from cogrip.protocol.line.jitter_buffer cimport JitterBuffer
from cogrip.protocol.line.received_waves cimport ReceivedWaves
from cogrip.protocol.laws.square_root cimport square_root


@cython.locals(square=double, value=double)
cdef double _square(tuple frame)


cdef class LineReceiver:
    cdef Py_ssize_t _axes
    cdef tuple _zero
    cdef public JitterBuffer _jitter_buffer
    cdef long long _ticks
    cdef long long _early
    cdef long long _phase
    cdef public long long hold
    cdef double _half_frame_s
    cdef public Concealment _concealment
    cdef public WaveLedger ledger
    cdef public object answer
    cdef bint _begun
    cdef long long _cursor
    cdef public long long newest
    cdef dict _waiting
    cdef set _missing
    cdef long long _anchor
    cdef tuple _late_wave
    cdef bint _fresh
    cdef public tuple _last
    cdef bint _concealing
    cdef public tuple overdue
    cdef long long _due_frames
    cdef long long _received
    cdef long long _applied
    cdef long long _late
    cdef long long _duplicate
    cdef long long _concealed
    cdef long long _gap_length
    cdef long long _longest_gap
    cdef long long _unheard
    cdef CompensatedSum _played_j
    cdef public ArrivedFrame metadata
    cdef public bint gap
    cdef public bint played
    cdef long long[256] _recent
    cdef long long[64] _arrived
    cdef double[6] _compensated
    cdef double[6] _spent

    @cython.locals(
        axes=Py_ssize_t, first="long long", phase="long long", count=Py_ssize_t, newest="long long", slot=Py_ssize_t,
        stored=ArrivedFrame,
    )
    cpdef bint take_in(self, ReceivedWaves datagram, long long early) except -1
    @cython.locals(
        first="long long", phase="long long", cursor="long long", newest="long long", oldest="long long", adapts=bint,
        place=Py_ssize_t, number="long long", waiting=dict, missing=set, arrived="long long*",
        frame=ArrivedFrame, stored=ArrivedFrame,
    )
    cdef ArrivedFrame _store(self, ReceivedWaves datagram, Py_ssize_t count, long long early)
    cdef bint _is_near(self, long long newest)
    cdef long long _begin(self) except? -1
    @cython.locals(number="long long", ticks="long long", move="long long", part=double, frame=tuple, filling=tuple, arrived=ArrivedFrame)
    cpdef tuple pop(self, long long frames=*)
    cpdef tuple play_overdue(self, long long ticks)
    cpdef tuple scale(self, tuple wave, double gain, double wanted, long long ticks)
    cdef _add_deficit(self, tuple frame, double part)
    cdef _miss(self, long long number)
    cdef long long _pass_over(self, long long number) except? -1
    cdef _drop_or_miss(self, long long number)
    cdef _advance(self, long long number, tuple frame)
    cpdef tuple _fill(self, late, bint silent, double part)
    cdef tuple _play(self, tuple frame, double part)
    @cython.locals(
        concealment=Concealment, axis=Py_ssize_t, value=double, played=double, before=double, reach=double, after=double,
        out=list, added="double*", reserves="double*", compensated="double*", spent="double*",
    )
    cdef tuple _compensate(self, tuple frame, double part)
    cpdef write_off(self, row)
    cpdef double energy_played_j(self)
    cpdef long long next_number(self)
    cpdef long long phase_to_spare(self)
