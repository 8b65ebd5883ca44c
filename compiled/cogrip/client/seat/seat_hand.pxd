cimport cython

from cogrip.client.coupling.interface cimport Coupling
from cogrip.client.safety.energy_ledger cimport EnergyLedger
from cogrip.client.effects.hand_aids cimport HandAids
from cogrip.client.hand_changes cimport HandChanges
from cogrip.client.seat.hand_motion cimport HandMotion
from cogrip.client.safety.limiter cimport Safety
from cogrip.devices.sample cimport Sample
from cogrip.protocol.wire.session cimport ClientSession


cdef class SeatHand:
    cdef public Coupling coupling
    cdef public Safety safety
    cdef public EnergyLedger ledger
    cdef public HandMotion hand
    cdef public object effects
    cdef public object settings
    cdef public ClientSession session
    cdef public object _axis_units
    cdef public object handle
    cdef public object capability
    cdef public object _record
    cdef public tuple force_n
    cdef public object _hand_map
    cdef public object _ordered
    cdef public HandAids aids
    cdef public HandChanges changes

    cpdef tuple tool_pose(self)
    cpdef _follow(self, Sample sample, bint border)
