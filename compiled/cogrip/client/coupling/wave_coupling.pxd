cimport cython

from cogrip.client.coupling.interface cimport Coupling, PortEnergy
from cogrip.client.coupling.series_impedance cimport SeriesImpedance
from cogrip.client.coupling.wave_lines cimport ForwardLine, ReturningLine
from cogrip.machine.addition cimport add_floats
from cogrip.protocol.line.receiver cimport LineReceiver
from cogrip.protocol.line.waves_encoding cimport encode_waves


cdef class WaveCoupling(Coupling):
    cdef public double _tick_s
    cdef public double b
    cdef public double root
    cdef public double _half_tick_s
    cdef public object _tuner
    cdef public double _device_nspm
    cdef public long long _since
    cdef public object _answered
    cdef public bint _from_displacement
    cdef public double _most_wave
    cdef public tuple _most_motion
    cdef public object late
    cdef long long _late_ticks
    cdef public SeriesImpedance _series
    cdef public double _ratio
    cdef public double _made_nspm
    cdef public long long _acknowledged
    cdef public long long _began
    cdef public long long _applied
    cdef public object forward
    cdef public ForwardLine up
    cdef public ReturningLine down
    cdef public PortEnergy energy
    cdef public tuple _impedances
    cdef public tuple _filters_hz
    cdef public object loops

    cpdef bint gap(self) except -1
    cpdef double given_j(self) except? -1.0
    cpdef double pending_j(self) except? -1.0
    cpdef double entered_j(self) except? -1.0
    @cython.locals(
        up=ForwardLine, down=ReturningLine, energy=PortEnergy, gain=double, ratio=double, b=double, full=double, root=double,
        impedance=double, per_wave=double, kept=double, axis=Py_ssize_t, made=double, used=double, vx=double, vy=double,
        vz=double, x=double, y=double, z=double, ux=double, uy=double, uz=double, u=double, v=double,
    )
    cpdef elapse(self, mean_velocity_mps, velocity_mps, double hold=*)
    @cython.locals(up=ForwardLine, v=double)
    cpdef elapse_absent(self)
    @cython.locals(wave=tuple)
    cpdef long long start_frame(self) except? -1
    @cython.locals(most=double)
    cpdef _play(self, tuple wave, long long ticks)
    @cython.locals(
        b=double, root=double, gain=double, deflected=bint, ratio=double, x=double, y=double, z=double, vx=double, vy=double,
        vz=double, fx=double, fy=double, fz=double, velocity=double, wave=double,
    )
    cpdef force(self, position_m, velocity_mps)
    @cython.locals(early="long long", fits=bint)
    cpdef bint receive(self, message) except -1
    @cython.locals(receiver=LineReceiver)
    cpdef tuple recorded(self)
