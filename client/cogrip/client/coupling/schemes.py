"""Coupling schemes at the client, by the name in `coupling.kind`.

A new one also needs a row at the server and more: docs/design.md, "Add a coupling scheme".
"""

from collections.abc import Callable
from dataclasses import dataclass

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.local_contact import LocalFaces, LocalWall
from cogrip.client.coupling.local_poses import LocalPoses
from cogrip.client.coupling.local_scene import LocalScene
from cogrip.client.coupling.passivity_control import PassivityControl
from cogrip.client.coupling.virtual_coupling import VirtualCoupling
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.settings.seat import SeatSettings
from cogrip.protocol.settings.types import Kind
from cogrip.protocol.wire.messages import Frame, Power, State, Waves


@dataclass(frozen=True, slots=True)
class Scheme:
    """One scheme at the client.

    make        the coupling of a seat
    message     type of the messages that both ends send
    damper      symbol, and key of [coupling], of the damper that the device itself renders
    softer_key  key of [coupling] to lower where the force oscillates
    """

    make: Callable[[SeatSettings], Coupling]
    message: type[Frame]
    damper: tuple[str, str]
    softer_key: str


def make_local(seat: SeatSettings) -> Coupling:
    """Return the coupling with local contact of a seat's kind of object."""
    makers: dict[str, Callable[[SeatSettings], Coupling]] = {
        "wall": LocalWall, "faces": LocalFaces, "scene": LocalPoses if seat.object.axes == POSE_AXES else LocalScene,
    }  # fmt: skip
    return makers[seat.object.kind](seat)


SCHEMES: dict[Kind, Scheme] = {
    "wave": Scheme(WaveCoupling, Waves, ("b", "impedance_nspm"), "impedance_nspm"),
    "local": Scheme(make_local, Waves, ("B", "damping_nspm"), "stiffness_npm"),
    "coupling": Scheme(VirtualCoupling, State, ("B", "damping_nspm"), "stiffness_npm"),
    "tdpa": Scheme(PassivityControl, Power, ("b", "impedance_nspm"), "stiffness_npm"),
}
