cimport cython

from cogrip.client.core cimport Delays
from cogrip.client.coupling.interface cimport Coupling
from cogrip.client.safety.device_port cimport DevicePort
from cogrip.client.seat.work_account cimport WorkAccount
from cogrip.client.seat.hand_motion cimport HandMotion
from cogrip.client.seat.seated cimport SeatedClient
from cogrip.client.tick_packing cimport pack_tick
from cogrip.devices.sample cimport Sample
from cogrip.machine.addition cimport add_floats


cdef class TickRecord:
    cdef object _encode
    cdef bytes _begin
    cdef bytes _end
    cdef Py_ssize_t _none_bytes
    cdef bytes _rest
    cdef bint _plain
    cdef tuple _held
    cdef long long _lost
    cdef object _skipped
    cdef object _age_ticks
    cdef object _buttons
    cdef double _reserve_j
    cdef object _playout_frames

    @cython.locals(
        coupling=Coupling, ledger=WorkAccount, port=DevicePort, hand=HandMotion, velocity=tuple, used=bint, plain=bint,
        same=bint, held=tuple, lost="long long", reserve_j=double, work_j=double, port_j=double, left_j=double,
    )
    cpdef bytes of(self, SeatedClient seat, Sample sample, tuple force_n, tuple timing, Delays delays)
    cdef bytes _encode_rest(self, head, given, unfit, orientation, grip_m)


@cython.locals(at=Py_ssize_t)
cdef bint _identical(tuple row, tuple other) except -1
