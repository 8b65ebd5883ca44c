cimport cython

from cogrip.client.io.exchange cimport Exchange
from cogrip.client.recorder cimport RecordedClient
from cogrip.client.supervised_device cimport SupervisedDevice


@cython.locals(now_ns="long long")
cpdef long long run_tick(
    long long tick, RecordedClient core, Exchange exchange, SupervisedDevice supervised, pacer, long long work_us,
) except? -1
