from cogrip.protocol.clock cimport Clock
from cogrip.protocol.line.sender cimport LineSender


cpdef bytes encode_waves(
    long long session, LineSender sender, double made_j, double port_j, long long acknowledged, Clock clock, long long now_ns,
    tuple state, long long phase, double impedance_nspm, long long since, long long edges,
    long long applied=*, handle=*,
)
