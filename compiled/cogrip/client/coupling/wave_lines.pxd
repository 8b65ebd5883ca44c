cimport cython

from cogrip.client.coupling.interface cimport PortEnergy
from cogrip.machine.addition cimport add_floats
from cogrip.protocol.laws.decimation cimport Decimator
from cogrip.protocol.line.energy_reserve cimport EnergyReserve
from cogrip.protocol.line.energy_sums cimport CompensatedSum
from cogrip.protocol.line.receiver cimport LineReceiver
from cogrip.protocol.line.sender cimport LineSender
from cogrip.protocol.line.wave_filter cimport WaveFilter


cdef class ForwardLine:
    cdef public Decimator decimator
    cdef public WaveFilter filter
    cdef public LineSender sender
    cdef public PortEnergy energy
    cdef public long long frame_ticks
    cdef double _half_frame_s
    cdef public list _withheld
    cdef public CompensatedSum given
    cdef public long long ticks
    cdef public long long phase
    cdef public long long spare
    cdef object _ends
    cdef public long long _shift
    cdef object _shifted
    cdef long long _asked

    @cython.locals(sent=tuple, mean=tuple, held=list, brought=double, going=double, most=double, scale=double)
    cpdef tuple end_frame(self, double spare_j)
    @cython.locals(spare="long long")
    cpdef long long next_length(self, long long acknowledged) except? -1


cdef class ReturningLine:
    cdef public LineReceiver receiver
    cdef public WaveFilter filter
    cdef public double gain
    cdef public list written_off
    cdef public object margin_j
    cdef public EnergyReserve reserve
    cdef long long _ticks_per_frame
    cdef double _rounding

    @cython.locals(wave=tuple, made_j=double, margin=double)
    cpdef tuple pop(self)
