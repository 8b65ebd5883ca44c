"""Sections of a settings file (docs/settings.md). Units are in the names.

Those of `[coupling]`, `[link]` and effects have modules of their own, and bounds that several have are in `types`.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec

from cogrip.protocol.axes import POSE_AXES
from cogrip.protocol.settings import types
from cogrip.protocol.settings.coupling import (
    CouplingSection,
)
from cogrip.protocol.settings.effects import MOST_EFFECTS, TANK_MJ, EffectSection, EffectTank
from cogrip.protocol.settings.hand import HandSection
from cogrip.protocol.settings.link_profile import Link
from cogrip.protocol.settings.object_kinds import KindText, LocalKindText, ObjectKind, kind_of, shared_kind
from cogrip.protocol.settings.rates import DeviceHz, Hz
from cogrip.protocol.settings.task import Task
from cogrip.protocol.settings.types import Name, Seconds, Seed, Side

REMOTE_FORCE_N = 40.0  # peak force that a record may claim: as strong as the arms on the market
REMOTE_SPEED_MPS = 4.0
REMOTE_TORQUE_NM = 3.0
REMOTE_SPEED_RADPS = 40.0
REMOTE: Mapping[str, float] = {
    "force_n": REMOTE_FORCE_N, "speed_mps": REMOTE_SPEED_MPS, "torque_nm": REMOTE_TORQUE_NM, "speed_radps": REMOTE_SPEED_RADPS,
}  # fmt: skip
"""Bounds of device records, by field of `Admission`, where it sets none."""
MOST_PEOPLE = 256
ONLY_USER = "anna"  # name of the person where a file names no users


class RatesSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[rates]: of the device loop, and of network and object."""

    device_hz: DeviceHz = 1024
    network_hz: Hz = 128


class Object(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The virtual object, as both ends know it."""

    kind: KindText = "cube"
    mass_kg: types.Mass = 0.2
    damping_nspm: types.Damping = 0.0
    axes: Annotated[int, msgspec.Meta(ge=1, le=POSE_AXES)] = 1

    @property
    def traits(self) -> ObjectKind:
        """Properties of its kind."""
        return kind_of(self.kind)


class ObjectSection(Object, frozen=True, forbid_unknown_fields=True):
    """[object]: of a scene also its files, start and steps a frame, which are the server's own: no welcome carries them."""

    # kind of the object; with the folder of a file, made absolute where settings are loaded
    kind: LocalKindText = "cube"
    file: str = ""  # path of an MJCF or URDF file; made absolute where settings are loaded
    folder: str = ""  # folder outside of which no file of a scene is read, absolute as `file`; "" the folder of `file`
    script: str = ""  # "python:FILE.py:CLASS", absolute as `kind`, that sets controls and moves mocap bodies of a scene
    keyframe: str = ""  # keyframe in which a scene begins; "" as its bodies stand
    ctrl: tuple[float, ...] = ()  # constant control of each actuator of a scene; () as the keyframe has it, else 0
    substeps: Annotated[int, msgspec.Meta(ge=1, le=64)] = 4

    def shared(self, axes: int) -> Object:
        """Return what both ends of a seat of `axes` axes know."""
        return Object(shared_kind(self.kind), self.mass_kg, self.damping_nspm, axes)


class Playout(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """[playout]: playout delay, redundancy, credit and concealment of both lines (SPEC.md 5)."""

    frames: Annotated[int, msgspec.Meta(ge=0, le=256)] | Literal["auto"] = "auto"  # auto: adapted to the jitter
    late: Annotated[float, msgspec.Meta(ge=0.0, le=0.2)] = 0.01  # rate of late frames that "auto" aims at
    redundancy: Annotated[int, msgspec.Meta(ge=1, le=32)] = 8
    tank_mj: Annotated[float, msgspec.Meta(ge=0.0, le=1e3)] = 80.0
    concealment: types.Concealed = "elastic"  # strategy for frames that are missing


class Admission(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Admission control and limits of seats. The server's own: no welcome carries it."""

    observers: Annotated[int, msgspec.Meta(ge=0, le=64)] = 8  # most observers of this room at once
    # most seats that one token holds at once, in all rooms
    seats_per_token: Annotated[int, msgspec.Meta(ge=1, le=65536)] = 8
    devices: Literal["any", "listed"] = "any"  # listed: a seat takes the device named for it in [[users]] alone
    # Bounds of device records: a record that claims more is refused, one without a bound gets this one. None: any; in an
    # encrypted room the bounds of `for_remote_clients`.
    force_n: types.RecordBound | None = None
    speed_mps: types.RecordBound | None = None
    torque_nm: types.RecordBound | None = None
    speed_radps: types.RecordBound | None = None
    power_w: types.Watts = types.HUMAN_POWER_W  # mean power of a seat; 0: F V of its record


class User(HandSection, frozen=True, forbid_unknown_fields=True):
    """One seat. The fields that are None are [coupling]'s; device_hz [rates]'s."""

    name: Name = ""
    device: str = "sim:phantom"
    hand: str = "reach"
    side: Side = "left"
    device_mass_kg: types.Mass = 0.1
    device_damping_nspm: types.Damping = 0.0
    impedance_nspm: types.Impedance | types.Auto | None = None
    wave_filter_hz: types.FilterHz | types.Auto | None = None
    prefer: types.Prefer | None = None
    stiffness_npm: types.Stiffness | None = None
    damping_nspm: types.Damping | None = None
    decimator: types.Decimator | None = None
    encoder: types.Encoder | None = None
    compensate: bool | None = None
    device_hz: DeviceHz | None = None
    power_w: types.Watts | None = None  # mean power of this person's seat; None: [admission]'s
    tool: str = ""  # body of a scene that this person moves; "" one is added; PINCH: with a gripper
    # orientation of that tool: "driven" by the hand; "" driven where the room has six axes, else as the body's joints have it
    orientation: types.Orientation = ""
    rotational_impedance_nms: types.RotationalImpedance | None = None
    grip_impedance_nspm: types.Impedance | None = None

    @property
    def grips(self) -> bool:
        """True where the hand drives a gripper, whose opening is an axis of its line."""
        return self.tool.partition(":")[0] == types.PINCH


OWN_COUPLING = tuple(name for name in CouplingSection.__struct_fields__ if name in User.__struct_fields__)
"""Keys of [coupling] that a person may have of their own."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All settings of a room."""

    name: Name = "session"
    seed: Seed = 1
    seconds: Seconds = 10.0
    rates: RatesSection = RatesSection()
    coupling: CouplingSection = CouplingSection()
    object: ObjectSection = ObjectSection()
    task: Task = Task()
    link: Link = Link()
    playout: Playout = Playout()
    admission: Admission = Admission()
    users: Annotated[tuple[User, ...], msgspec.Meta(min_length=1, max_length=MOST_PEOPLE)] = (User(name=ONLY_USER),)
    effects: Annotated[tuple[EffectSection, ...], msgspec.Meta(max_length=MOST_EFFECTS)] = ()
    # energy of each person that active effects may draw, and that fixtures cost
    effect_tank_mj: EffectTank = TANK_MJ
