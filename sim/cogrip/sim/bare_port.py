"""Device port without its passivity controllers, for experiments on them: no live seat can have it."""

from collections.abc import Sequence
from math import inf

from cogrip.client.safety.device_port import Cause, DevicePort
from cogrip.devices.device import Capability


class BarePort(DevicePort):
    """The ledger alone, for experiments on force laws without a hand: nothing is limited, adapted or released."""

    def set_record(self, capability: Capability) -> None:
        super().set_record(capability)
        self.carried.nspm = self._free_j = inf

    @property
    def injected_nspm(self) -> float:
        return 0.0

    def limit(self, force_n: Sequence[float]) -> Sequence[float]:
        return force_n

    def watch(self, *of_tick: object, limited: bool = False, reduced: bool = False) -> Cause:
        return ""
