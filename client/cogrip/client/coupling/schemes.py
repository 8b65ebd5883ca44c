"""Coupling schemes at the client, by the name in `coupling.kind`.

A new one also needs a row with its properties and one at the server: docs/design.md, "Add a coupling scheme".
"""

from collections.abc import Callable

from cogrip.client.coupling.interface import Coupling
from cogrip.client.coupling.local.local_contact import Contact, LocalCoupling
from cogrip.client.coupling.local.local_poses import PoseContact
from cogrip.client.coupling.local.local_scene import SceneContact
from cogrip.client.coupling.local.local_surface import Face, Wall
from cogrip.client.coupling.partner.partner_coupling import PartnerCoupling
from cogrip.client.coupling.partner.uncopied_scene import UncopiedScene
from cogrip.client.coupling.passivity_control import PassivityControl
from cogrip.client.coupling.virtual_coupling import VirtualCoupling
from cogrip.client.coupling.wave_coupling import WaveCoupling
from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.settings.coupling_kinds import Kind
from cogrip.protocol.settings.object_kinds import kind_of
from cogrip.protocol.settings.seat import SeatSettings

MakeCoupling = Callable[[SeatSettings], Coupling]


def scene_contact(seat: SeatSettings, line: LocalCoupling) -> Contact:
    """Return the contact of a scene: of the tool's place, or of its pose."""
    return PoseContact(seat, line) if seat.object.axes == POSE_AXES else SceneContact(seat, line)


LOCAL_CONTACTS: dict[str, Callable[[SeatSettings, LocalCoupling], Contact]] = {
    "wall": Wall,
    "faces": Face,
    "scene": scene_contact,
}
"""Contact that a client renders itself, by kind of object: of each that is `local` in `object_kinds`."""


def make_local(seat: SeatSettings) -> Coupling:
    """Return the coupling with local contact of a seat's kind of object."""
    return LocalCoupling(seat, LOCAL_CONTACTS[seat.object.kind])


def make_partner(seat: SeatSettings) -> Coupling:
    """Return the coupling with partners' models of a seat; MuJoCo is loaded where there is a scene."""
    if not kind_of(seat.object.kind).scene:
        return PartnerCoupling(seat)
    try:
        from cogrip.client.coupling.partner.partner_pose import PartnerPoseCoupling
        from cogrip.client.coupling.partner.partner_scene import PartnerSceneCoupling
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        return UncopiedScene(seat)
    return PartnerPoseCoupling(seat) if seat.object.axes == POSE_AXES else PartnerSceneCoupling(seat)


SCHEMES: dict[Kind, MakeCoupling] = {
    "wave": WaveCoupling,
    "local": make_local,
    "coupling": VirtualCoupling,
    "tdpa": PassivityControl,
    "partner": make_partner,
}


def make_coupling(seat: SeatSettings) -> Coupling:
    """Return the coupling of a seat."""
    return SCHEMES[seat.coupling.kind](seat)
