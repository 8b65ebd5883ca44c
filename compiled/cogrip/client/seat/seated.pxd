cimport cython

from cogrip.client.coupling.interface cimport Coupling
from cogrip.client.safety.device_port cimport DevicePort
from cogrip.client.seat.work_account cimport WorkAccount
from cogrip.client.sources.force_source cimport ForceSources
from cogrip.client.hand.axes cimport AxisUnits
from cogrip.client.hand.frame cimport HandFrame
from cogrip.client.seat.hand_force cimport HandForce
from cogrip.client.seat.hand_motion cimport HandMotion, work_and_velocity
from cogrip.client.seat.peaks cimport Peaks
from cogrip.client.safety.limiter cimport Safety
from cogrip.client.safety.shaking cimport Shaking
from cogrip.devices.sample cimport Sample
from cogrip.protocol.wire.session cimport ClientSession


cdef class SeatedClient:
    cdef public AxisUnits units
    cdef public HandFrame frame
    cdef public HandMotion hand
    cdef public object aids
    cdef public object effects
    cdef public ForceSources sources
    cdef public Coupling coupling
    cdef public Safety safety
    cdef public WorkAccount ledger
    cdef public ClientSession session
    cdef public object settings
    cdef public object orders
    cdef public object handle
    cdef public object capability
    cdef public object _record
    cdef public tuple force_n
    cdef public object session_id
    cdef public DevicePort port
    cdef public HandForce _force
    cdef public Peaks peaks
    cdef public Shaking shaking
    cdef public long long tick
    cdef public long long _acted
    cdef public long long _ticks_per_frame
    cdef public long long _frame_begin
    cdef public long long _frame_end
    cdef public long long _wave_end
    cdef public double _rate_hz
    cdef public object _origin_m
    cdef public tuple _origin_pose
    cdef public tuple _frame_start_m
    cdef public object _leaving
    cdef public object rest

    @cython.locals(elapsed="long long", hand=HandMotion, ended=bint)
    cpdef sense(self, long long tick, Sample sample, long long now_ns)
    cpdef tuple tool_pose(self)
    cpdef tuple place(self)
    cdef _follow(self, Sample sample, bint border)
    @cython.locals(
        coupling=Coupling, ledger=WorkAccount, hand=HandMotion, frame=HandFrame, port=DevicePort, sources=ForceSources, ratio=double, work=double,
        first="long long", tick="long long", length="long long", ended=bint, absent=bint, held=bint, hold=double,
        given_j=double, pending_j=double,
    )
    cdef bint _account(self, long long elapsed, tuple position_m) except -1
    cdef _coupling_part(self, long long elapsed, force, tuple position_m)
    @cython.locals(ticks="long long", late="long long")
    cdef _start_frame(self, long long tick)
    @cython.locals(stored_j=double)
    cdef _end_frame(self, tuple position_m, long long ticks)
    @cython.locals(coupling=Coupling, safety=Safety, force=tuple)
    cpdef tuple act(self, long long now_ns)
    cdef _degrade(self, cause)
