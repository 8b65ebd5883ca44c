"""The couplings a client can be joined by, by the name in `coupling.kind`."""

from collections.abc import Callable

from cogrip.client.passivity_control import PassivityControl
from cogrip.client.virtual_coupling import VirtualCoupling
from cogrip.client.wave_coupling import WaveCoupling
from cogrip.protocol.settings import SeatSettings

Coupling = WaveCoupling | VirtualCoupling | PassivityControl

COUPLINGS: dict[str, Callable[[SeatSettings], Coupling]] = {
    "wave": WaveCoupling,
    "coupling": VirtualCoupling,
    "tdpa": PassivityControl,
}
