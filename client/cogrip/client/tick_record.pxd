cimport cython

from cogrip.client.core cimport Delays
from cogrip.client.coupling cimport Coupling
from cogrip.client.device_port cimport DevicePort
from cogrip.client.energy_ledger cimport EnergyLedger
from cogrip.client.hand_motion cimport HandMotion
from cogrip.client.seated cimport SeatedClient
from cogrip.client.tick_packing cimport pack_tick


cdef class TickRecord:
    cdef object _encode
    cdef bytes _begin
    cdef bytes _end
    cdef Py_ssize_t _none_bytes
    cdef tuple _rows
    cdef tuple _numbers
    cdef bytes _rest

    @cython.locals(
        coupling=Coupling, ledger=EnergyLedger, port=DevicePort, hand=HandMotion, velocity=tuple, used=bint, same=bint,
        numbers=tuple, work_j=double, port_j=double, left_j=double,
    )
    cpdef bytes of(self, SeatedClient seat, sample, tuple force_n, tuple timing, Delays delays)
