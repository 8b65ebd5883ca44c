cimport cython

from cogrip.client.io.exchange cimport Exchange
from cogrip.client.recorder cimport RecordedClient
from cogrip.client.safety.limiter cimport Safety
from cogrip.client.supervised_device cimport SupervisedDevice
from cogrip.machine.pacing cimport Pacer
from cogrip.protocol.wire.session cimport ClientSession


@cython.locals(session=ClientSession, safety=Safety, tick="long long", now_ns="long long", end_ns="long long")
cpdef tuple run_ticks(
    RecordedClient core, Exchange exchange, SupervisedDevice supervised, Pacer pacer, long long work_us, long long until,
    str session_state, str safety_state,
)
