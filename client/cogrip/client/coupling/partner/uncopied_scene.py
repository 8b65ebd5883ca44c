"""A scene with partners' models where there is no MuJoCo to step a copy of it: the hand feels nothing, and tells of nothing.

Whoever joins is told so, and refused, before a device is held (`cogrip.cli.session.joined_device`).
"""

from collections.abc import Sequence

from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.wire.messages import Geom, Partner


class UncopiedScene(PartnerCoupling):
    """See above."""

    def receive_shape(self, geom: Geom) -> bool:
        return True

    def receive(self, message: Partner) -> bool:
        return message.of_axes(len(self.still), POSE_AXES) and self._receiver.receive(message)

    def force(self, position_m: Sequence[float], velocity_mps: Sequence[float]) -> Sequence[float]:
        return self.still
