cimport cython

from cogrip.client.coupling.interface cimport Coupling
from cogrip.client.hand.frame cimport HandFrame
from cogrip.client.safety.device_port cimport DevicePort
from cogrip.client.safety.limiter cimport Safety
from cogrip.client.safety.shaking cimport Shaking
from cogrip.client.seat.hand_motion cimport HandMotion
from cogrip.client.sources.force_source cimport ForceSources


cdef class HandForce:
    cdef public Coupling coupling
    cdef public ForceSources sources
    cdef public DevicePort port
    cdef public Safety safety
    cdef public Shaking shaking
    cdef public str cause

    @cython.locals(
        coupling=Coupling, safety=Safety, port=DevicePort, sources=ForceSources, force=tuple, carried=double,
        carried_npm=double,
    )
    cpdef tuple force(self, long long tick, HandMotion hand, HandFrame frame)
    @cython.locals(
        coupling=Coupling, safety=Safety, port=DevicePort, sources=ForceSources, reduced=bint, fraction=double, wish=double,
        local=double, left=double, other=double,
    )
    cdef _watch(self, wanted_n, tuple force, HandFrame frame)
